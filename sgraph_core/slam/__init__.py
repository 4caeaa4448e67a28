"""Concepts for SLAM code, keyframe by keyframe; see docs/slam.md."""

from sgraph_core.slam.inference import Work
from sgraph_core.slam.nodes import NodeChanges
from sgraph_core.slam.tracker import ConceptTracker
from sgraph_core.slam.update import Update

__all__ = ["ConceptTracker", "NodeChanges", "Update", "Work"]
