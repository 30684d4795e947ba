"""The recording that would tell rival models apart, and how it is played on them."""
