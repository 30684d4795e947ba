"""Models with an effect more or less, fitted again and judged on held-out runs."""
