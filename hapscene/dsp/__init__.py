"""Signal processing: AR filters, lattice filters, reproducible noise, linear prediction, spectrograms."""
