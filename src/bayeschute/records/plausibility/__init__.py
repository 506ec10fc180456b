"""Whether a record can be true: laws between its channels and its vehicle, and the mistake behind a breach."""
