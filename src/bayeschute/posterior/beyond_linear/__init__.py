"""What linear models of flights leave out of the marginal density, by Laplace's approximation at other points."""
