"""Flight records: read, checked, cleaned, resampled, and motion reconstructed from them."""
