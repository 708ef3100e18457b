"""Groups of methods that have one name, for studies: ``--algorithms paper,improved``.

`paper` is the six of the ESREL paper as first published, or as the author's program has them.
`improved` is the same six with real encoding, neighbourhoods, strategies and rates that were tuned
with one effort for all. `best` is what one would use. Nothing here loads a method.
"""

PRESETS = {
    "paper": ("ga-holland", "pso-inertia", "de-rand", "gwo", "da", "woa"),
    "improved": ("ga-tuned", "pso-tuned", "de-tuned", "gwo-tuned", "da-tuned", "woa-tuned"),
    "best": ("multistart", "scipy-trf", "cma", "scipy-de", "ga", "pso", "de"),
}
"""What ``--algorithms paper``, ``improved`` and ``best`` stand for, in this order."""

SINGLE = ("pygmo-sga", "pygmo-de", "pygmo-sade", "pygmo-de1220", "pygmo-pso", "pygmo-gwo")
"""Methods whose library evaluates one point at a time, so that their seconds are not comparable."""
