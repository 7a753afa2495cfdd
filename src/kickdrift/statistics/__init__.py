"""Numbers about series: means with errors, drift, waves and trends. Knows no Simulation."""
