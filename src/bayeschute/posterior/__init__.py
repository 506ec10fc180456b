"""From the fit along the record to the marginal posterior and draws of it."""
