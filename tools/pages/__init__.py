"""The documents as programs: what their blocks say is run, by the tests and by the site."""
