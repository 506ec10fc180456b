"""Tables of the report as plain values."""
