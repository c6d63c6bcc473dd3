"""Synthesis of controllers from models: loop, prefilter, anti-windup, headroom and verdict."""
