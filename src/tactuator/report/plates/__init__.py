"""Figures of the report: of a controller, of a device, of what is felt."""
