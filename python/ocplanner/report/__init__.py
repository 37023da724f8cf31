"""Charts, pictures of plans, videos and the report page."""
