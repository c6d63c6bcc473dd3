"""Words that subjects and operators read, in their language."""
