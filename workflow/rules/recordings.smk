# Raw recordings to clean tracks: generated for the demo, fetched where a dataset file lists sources; otherwise the user is asked for them.
#
# INPUTS   nothing, a dataset file's `sources`, or raw files under data_root
# OUTPUTS  raw files that are not there yet; results/{run}/{dataset}/tracks: clean recordings and their accounts, checks.json
# STEPS    make_demo_recording, make_demo_floor_plan | fetch_recording; clean_recording; check_splits
from modlhmp.study.demo import RECORDINGS as DEMO_RECORDINGS

DEMO_FILES = {recording.file: recording for recording in DEMO_RECORDINGS}
# Files that exist belong to the user: no rule may make them, since Snakemake would remove them first.
MISSING = {
    recording.stored: (name, recording.file)
    for name, dataset in DATASETS.items()
    for recording in dataset.recordings
    if not dataset.demo and not recording.exists
} | {
    file: (name, os.path.relpath(file, DATA_ROOT))
    for name, dataset in DATASETS.items()
    for file in dataset.floor_plan
    if not dataset.demo and not Path(file).exists()
}


rule make_demo_recording:
    """Write one made-up day in the true raw format, bad rows and tracks planted."""
    output:
        f"{LAYOUT.demo}/{{file}}",
    log:
        LAYOUT.log("make_demo_recording", "{file}"),
    benchmark:
        LAYOUT.benchmark("make_demo_recording", "{file}")
    wildcard_constraints:
        file="|".join(DEMO_FILES),
    priority: 2
    group:
        "recordings"
    resources:
        mem_mb=1500,
        runtime=5,
    params:
        day=lambda wildcards: DEMO_FILES[wildcards.file]._asdict(),
        demo=as_plain(RUN.demo),
        code=code_of("make_demo_recording"),
    message:
        "Demo recording {wildcards.file}"
    script:
        "../scripts/make_demo_recording.py"


rule make_demo_floor_plan:
    """Write the floor plan of the made-up hall."""
    output:
        yaml=f"{LAYOUT.demo}/hall/hall.yaml",
        image=f"{LAYOUT.demo}/hall/hall.pgm",
    log:
        LAYOUT.log("make_demo_floor_plan"),
    benchmark:
        LAYOUT.benchmark("make_demo_floor_plan")
    priority: 2
    group:
        "recordings"
    resources:
        mem_mb=1500,
        runtime=5,
    params:
        code=code_of("make_demo_floor_plan"),
    message:
        "Demo floor plan"
    script:
        "../scripts/make_demo_floor_plan.py"


rule fetch_recording:
    """Download a recording that its dataset file lists, or say where it can be obtained."""
    output:
        update("{missing}"),  # a file that is put there meanwhile stays
    log:
        LAYOUT.log("fetch_recording", "{missing}"),
    wildcard_constraints:
        missing="|".join(map(re.escape, MISSING)) or "nothing_is_missing",
    resources:
        mem_mb=1500,
        runtime=240,
    params:
        file=lambda wildcards: MISSING[wildcards.missing][1],
        dataset=lambda wildcards: PLAN.settings_of(
            MISSING[wildcards.missing][0],
            ("title", "owner_page", "sources", "floor_plan", *CLEANING_KEYS),
        ),
        recordings=lambda wildcards: [
            as_plain(one)
            for one in DATASETS[MISSING[wildcards.missing][0]].recordings
            if one.stored == wildcards.missing
        ],
        missing=lambda wildcards: sorted(
            file
            for name, file in MISSING.values()
            if name == MISSING[wildcards.missing][0]
        ),
        sums=SUMS,
    message:
        "Fetch {wildcards.missing}"
    script:
        "../scripts/fetch_recording.py"


rule clean_recording:
    """Read a recording, drop bad rows and tracks, counted by reason, and resample it to the time step."""
    input:
        raw=files_of_recording,
    output:
        tracks=LAYOUT.tracks("{dataset}", "{recording}"),
        account=LAYOUT.account("{dataset}", "{recording}"),
    log:
        LAYOUT.log("clean_recording", "{dataset}", "{recording}"),
    benchmark:
        LAYOUT.benchmark("clean_recording", "{dataset}", "{recording}")
    priority: 2
    group:
        "recordings"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        dataset=settings_of(*CLEANING_KEYS),
        recording=lambda wildcards: {
            key: as_plain(
                getattr(
                    DATASETS[wildcards.dataset].recording(wildcards.recording), key
                )
            )
            for key in (
                *("file", "member", "day", "start", "days", "people"),
                *("chosen", "side", "part"),
            )
        },
        sources=lambda wildcards: as_plain(DATASETS[wildcards.dataset].sources),
        sums=SUMS,
        code=code_of("clean_recording"),
    message:
        "Clean {wildcards.dataset} {wildcards.recording}"
    script:
        "../scripts/clean_recording.py"


rule check_splits:
    """Compare all recordings of a dataset: nobody in both splits, tests where somebody trained, of its horizon."""
    input:
        tracks=tracks_of(None),
    output:
        LAYOUT.checks("{dataset}"),
    log:
        LAYOUT.log("check_splits", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("check_splits", "{dataset}")
    priority: 2  # before maps and forecasts, which would be in vain
    group:
        "recordings"
    resources:
        mem_mb=1500,
        runtime=15,
    params:
        recordings=lambda wildcards: [
            {key: getattr(one, key) for key in ("name", "path", "day", "split")}
            for one in DATASETS[wildcards.dataset].recordings
        ],
        dataset=settings_of("accept", "strict", "forecast_every_s", *SITE_KEYS),
        code=code_of("check_splits"),
    message:
        "Check the splits of {wildcards.dataset}"
    script:
        "../scripts/check_splits.py"
