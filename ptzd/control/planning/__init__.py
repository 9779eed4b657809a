"""Where to look: poses, zooms and intervals from the geometry of a request."""
