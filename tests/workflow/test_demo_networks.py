"""What the demo's networks learn with their small budgets."""

import json

import pytest

from modlhmp.kinds import BUILT_IN

GAIN = 0.05  # of the validation ADE, from the first epoch to the best one


@pytest.mark.full
def test_every_network_of_the_demo_learns(project):
    """Its validation ADE falls on both recordings; budgets that only run would show nothing of a method."""
    kinds = [kind.name for kind in BUILT_IN if kind.learned]
    files = [f"results/demo/demo_{place}/models/{name}.json" for place in ("hall", "forum") for name in kinds]
    project.snakemake("--cores", 2, "--", *files)
    for file in files:
        curve = [epoch["validation_ade_m"] for epoch in json.loads((project.folder / file).read_text())["curve"]]
        assert min(curve) < (1 - GAIN) * curve[0], (file, curve)
