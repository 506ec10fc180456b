"""Public Python interface behind `import bayeschute`: flights, priors, fits, posteriors, forecasts and functions."""
