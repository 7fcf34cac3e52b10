# Raw recordings: generated for the demo, fetched where a dataset file lists sources, else asked of the user.
#
# INPUTS   nothing, or a dataset file's `sources`
# OUTPUTS  raw files that are not there yet: under resources/demo, or under data_root
# STEPS    make_demo_recording, make_demo_floor_plan | fetch_recording
from modlhmp.study.demo import RECORDINGS as DEMO_RECORDINGS

DEMO_FILES = {recording.file: recording for recording in DEMO_RECORDINGS}
# Files that are there belong to the user: no rule may make, and so first remove, them.
MISSING = {
    recording["stored"]: (name, recording["file"])
    for name, dataset in DATASETS.items()
    for recording in dataset["recordings"]
    if not dataset["demo"] and not recording["exists"]
} | {
    file: (name, os.path.relpath(file, data_root()))
    for name, dataset in DATASETS.items()
    for file in dataset["floor_plan"]
    if not dataset["demo"] and not Path(file).exists()
}


rule make_demo_recording:
    """Write one made-up day in the true raw format, bad rows and tracks planted."""
    output:
        f"resources/demo/{RUN}/{{file}}",
    log:
        f"results/{RUN}/logs/make_demo_recording/{{file}}.log",
    wildcard_constraints:
        file="|".join(DEMO_FILES),
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        day=lambda wildcards: DEMO_FILES[wildcards.file]._asdict(),
        demo=config["demo"],
        code=code_of("make_demo_recording"),
    message:
        "Demo recording {wildcards.file}"
    script:
        "../scripts/make_demo_recording.py"


rule make_demo_floor_plan:
    """Write the floor plan of the made-up hall."""
    output:
        yaml=f"resources/demo/{RUN}/hall/hall.yaml",
        image=f"resources/demo/{RUN}/hall/hall.pgm",
    log:
        f"results/{RUN}/logs/make_demo_floor_plan.log",
    resources:
        mem_mb=500,
        runtime=5,
    params:
        code=code_of("make_demo_floor_plan"),
    message:
        "Demo floor plan"
    script:
        "../scripts/make_demo_floor_plan.py"


rule fetch_recording:
    """Download a recording that its dataset file lists, or say where a person gets it."""
    output:
        update("{missing}"),  # a file that is put there meanwhile stays
    log:
        f"results/{RUN}/logs/fetch_recording/{{missing}}.log",
    wildcard_constraints:
        missing="|".join(map(re.escape, MISSING)) or "nothing_is_missing",
    resources:
        mem_mb=500,
        runtime=240,
    params:
        file=lambda wildcards: MISSING[wildcards.missing][1],
        dataset=lambda wildcards: {
            key: DATASETS[MISSING[wildcards.missing][0]].get(key)
            for key in ("title", "owner_page", "sources", "floor_plan")
        },
        missing=lambda wildcards: sorted(
            file
            for name, file in MISSING.values()
            if name == MISSING[wildcards.missing][0]
        ),
        sums="resources/SHA256SUMS",
    message:
        "Fetch {wildcards.missing}"
    script:
        "../scripts/fetch_recording.py"
