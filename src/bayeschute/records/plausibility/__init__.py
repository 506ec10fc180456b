"""Physical plausibility of a record: laws between its channels and its vehicle, and likely mistakes behind a breach."""
