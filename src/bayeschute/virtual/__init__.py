"""Virtual drops: simulated flights with disturbances that the identification does not know."""
