"""Check cases: simulated flights against closed forms."""
