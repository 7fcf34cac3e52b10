# Runtime study: time, memory, map size and their growth. A target of its own, `snakemake --cores 2 runtime`, since
# timings are worth something only while nothing else runs.
#
# INPUTS   clean test tracks, the studied method's map
# OUTPUTS  results/{run}/{dataset}/runtime.json; paper_figures/{run}/runtime.{csv,pdf,png}
# STEPS    measure_runtime, figure_runtime; runtime collects them


rule measure_runtime:
    """Time a track, memory and map size of the studied method, in a process of its own."""
    input:
        tracks=track_files("test"),
        map=lambda wildcards: map_path(
            f"results/{RUN}/{wildcards.dataset}/maps", STUDY_METHOD["kind"]
        ),
    output:
        f"results/{RUN}/{{dataset}}/runtime.json",
    log:
        f"results/{RUN}/logs/measure_runtime/{{dataset}}.log",
    threads: 1000  # capped to all there are, so it runs alone
    resources:
        mem_mb=1500,
        runtime=15,
    params:
        task=lambda wildcards: {
            "kind": STUDY_METHOD["kind"],
            "options": STUDY_METHOD["options"],
            "dataset": settings_of(wildcards.dataset, STUDY_KEYS),
            "max_tracks": 2000,
        },
        code=code_of("measure_runtime"),
    message:
        "Measure the runtime on {wildcards.dataset}"
    script:
        "../scripts/measure_runtime.py"


rule figure_runtime:
    """Time, memory and map size beside the paper's, and their growth (the paper's runtime analysis)."""
    input:
        expand(rules.measure_runtime.output, dataset=DATASETS),
    output:
        csv=f"{EXHIBITS}/runtime.csv",
        pdf=f"{EXHIBITS}/runtime.pdf",
        png=report(
            f"{EXHIBITS}/runtime.png",
            caption="../report/runtime.rst",
            category="Studies",
            labels={"exhibit": "runtime", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_runtime.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        method=config["methods"][STUDY["method"]]["title"],
        code=code_of("figure_runtime"),
    message:
        "Figure runtime"
    script:
        "../scripts/figure_runtime.py"


rule runtime:
    """The runtime study; nothing else should run on the machine meanwhile."""
    input:
        rules.figure_runtime.output,
