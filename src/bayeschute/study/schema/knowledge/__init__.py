"""Tables of a study on external knowledge of its coefficients and curves."""
