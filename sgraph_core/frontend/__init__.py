"""From sensor data to maps: a simulated lidar, scenes, real logs, and a planes-only SLAM front end.

A :class:`~sgraph_core.frontend.recording.Recording` is what a drive leaves behind: odometry, what
each keyframe observed, and a reference to judge by. It comes from a simulated drive
(:mod:`.simulation`, on the plans of :mod:`.scenes`) or from a Carmen log (:mod:`.carmen`).
:func:`~sgraph_core.frontend.mapping.build_map` makes an S-Graph of it.
"""
