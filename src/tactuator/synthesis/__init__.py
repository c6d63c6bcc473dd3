"""From models to controllers: loop, prefilter, anti-windup, headroom and verdict."""
