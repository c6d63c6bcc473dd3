"""Exchange of controllers with other tools: python-control, continuous forms."""
