"""What `import bayeschute` offers: flights, priors, fits, posteriors, forecasts, and the verbs between them."""
