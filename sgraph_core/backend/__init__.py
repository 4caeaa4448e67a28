"""From an S-Graph to a gtsam factor graph, and back.

Two ways to use it: :func:`optimize` builds and solves the whole graph; :func:`concept_factors`
hands the concepts' factors out, for a graph and keys of one's own. The frames are the map file's:
keyframe variables are world_T_body, planes are in the world with the normal towards the observer.
"""

from sgraph_core.backend.association import Association, Proposal, Same, associate
from sgraph_core.backend.concept_factors import ConceptFactors, FactorGroup, concept_factors
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers, low_layers
from sgraph_core.backend.optimize import Optimization, optimize
from sgraph_core.backend.robust import Refusal
from sgraph_core.backend.sightings import plane_noise, plane_value

__all__ = [
    "Association",
    "ConceptFactors",
    "FactorGroup",
    "Keys",
    "LowLayers",
    "Optimization",
    "Proposal",
    "Refusal",
    "Same",
    "associate",
    "concept_factors",
    "low_layers",
    "optimize",
    "plane_noise",
    "plane_value",
]
