"""Synthetic buildings with their truth: what the network is trained on.

``sgraph synth`` writes them as map files. The steps: a plan (:mod:`.plan`), its surfaces with doors
and furniture (:mod:`.surfaces`), and what a robot would have mapped of them (:mod:`.view`).
"""
