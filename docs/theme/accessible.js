// Names for what the theme's scripts make, and the keyboard's way into wide tables.
function name() {
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-typeset__scrollwrap, math[display=block], .md-typeset pre > code, .md-typeset .highlight pre").forEach(one => { one.tabIndex = 0; });
  document.querySelectorAll(".md-code__nav").forEach((one, i) => one.setAttribute("aria-label", `Code ${i + 1}`));
}
new MutationObserver(name).observe(document.documentElement, {childList: true, subtree: true});
name();
