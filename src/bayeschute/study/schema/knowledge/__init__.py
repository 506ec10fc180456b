"""Tables of a study on what others know about its coefficients and curves."""
