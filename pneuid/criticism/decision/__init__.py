"""From trials to a verdict: what is accepted, what is a rival, what the diagnosis says."""
