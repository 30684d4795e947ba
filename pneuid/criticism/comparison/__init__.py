"""A model held against measurements, in words and numbers that an engineer uses."""
