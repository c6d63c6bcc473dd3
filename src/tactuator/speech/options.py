"""What a rendering is asked for where nothing else is said. Nothing heavy is imported here."""

LEVEL_DB_SL = 35.0
CODING = "direct"
