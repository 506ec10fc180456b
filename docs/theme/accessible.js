// Names for what the theme's scripts make, and the keyboard's way into wide tables, code and equations.
const WIDE = ".md-typeset__scrollwrap, .md-typeset pre > code, math[display=block]";

function complete() {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(WIDE).forEach(one => { one.tabIndex = 0; });
  document.querySelectorAll(".md-code__nav").forEach((one, i) => one.setAttribute("aria-label", `Code ${i + 1}`));
}

new MutationObserver(complete).observe(document.documentElement, {childList: true, subtree: true});
complete();
