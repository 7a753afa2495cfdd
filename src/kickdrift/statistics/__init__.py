"""Numbers about series: means with errors, drift, spectral lines and trends. Knows no Simulation."""
