"""What each effect of the catalogue would gain and would show, without fitting any of them."""
