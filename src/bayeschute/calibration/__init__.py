"""What intervals and bands hold over many replicates."""
