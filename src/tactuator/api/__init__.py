"""The flat Python API: the chain's verbs, and results that draw, tabulate and print themselves.

`import tactuator as tt` offers what stands here by name, imported when it is asked for.
"""
