"""Where a model fails and which physical effect it lacks."""
