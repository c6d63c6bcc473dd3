"""What subjects and operators read, in their language."""
