"""From recordings to parameters: first guess, multiple shooting, uncertainty."""
