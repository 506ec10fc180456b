"""The fit along the record: parameters and trajectory together, defects made smaller level by level."""
