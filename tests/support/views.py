"""What robots map of synthetic buildings, for tests."""

from __future__ import annotations

from sgraph_core.synth.config import ViewConfig

EXACT_VIEW = ViewConfig(
    occluded_share=0.0,
    drifted_share=0.0,
    through_share=(0.0,),
    fragmented_share=0.0,
    missing_share=(0.0,),
    cropped_share=(0.0,),
    duplicate_share=(0.0,),
    noise_m=(0.0,),
)
"""Everything is mapped, whole, once and where it is."""
