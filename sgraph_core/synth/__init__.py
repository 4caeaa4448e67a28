"""Synthetic buildings with their truth: what the network is trained on.

``sgraph synth`` writes them as map files. The steps: a plan of rooms (:mod:`.plan`, with
:mod:`.interior` and :mod:`.open_plan`); its surfaces with their openings and clutter
(:mod:`.surfaces`, :mod:`.cutouts`, :mod:`.clutter`); what a robot maps of them (:mod:`.view`, with
:mod:`.trajectory` and :mod:`.occlusion`); drift and noise of the map (:mod:`.drift`,
:mod:`.building`). Or its grid (:mod:`.robot_grid`, with :mod:`.grid_scene`, :mod:`.grid_drawing`,
:mod:`.scans`) and the truth of what is extracted from it (:mod:`.grid_truth`).
"""
