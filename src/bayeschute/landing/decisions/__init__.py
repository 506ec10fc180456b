"""What landings tell: how likely limits are kept and how sure that is, what drives it, what to test next."""
