"""Verbs from models to images: design, check, wordlength, build, image, firmware."""
