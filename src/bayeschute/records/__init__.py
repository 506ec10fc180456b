"""Flight records: read, checked, cleaned, resampled, and motion reconstructed from them."""

from bayeschute.core import threads as threads  # sums of matrix products are rounded alike on any number of cores
