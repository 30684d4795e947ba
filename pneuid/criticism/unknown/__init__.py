"""What no effect of the catalogue explains: an unknown function of a signal, found, drawn and put into a formula."""
