# Maps of dynamics from the training recordings.
#
# INPUTS   clean training tracks
# OUTPUTS  results/{run}/{dataset}/maps: cliff.parquet, tc_cliff/{hour}.parquet, stef.parquet, stef/{hour}.parquet,
#          episodes.parquet, snippets.parquet, exits.parquet
# STEPS    build_cliff, build_tc_cliff, build_stef, build_episodes, build_snippets, build_exits


rule build_cliff:
    """CLiFF-map of all training hours together."""
    input:
        tracks=track_files("train"),
    output:
        f"results/{RUN}/{{dataset}}/maps/cliff.parquet",
    log:
        f"results/{RUN}/logs/build_cliff/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_cliff/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=config["maps"]["cliff"],
        code=code_of("build_cliff"),
    message:
        "CLiFF-map of {wildcards.dataset}"
    script:
        "../scripts/build_cliff.py"


rule build_tc_cliff:
    """Time-conditioned CLiFF-map: one map for each clock hour that has training data."""
    input:
        tracks=track_files("train"),
    output:
        directory(f"results/{RUN}/{{dataset}}/maps/tc_cliff"),
    log:
        f"results/{RUN}/logs/build_tc_cliff/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_tc_cliff/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        options=config["maps"]["cliff"],
        timezone=lambda wildcards: DATASETS[wildcards.dataset]["timezone"],
        hours=lambda wildcards: DATASETS[wildcards.dataset]["hours"],
        code=code_of("build_tc_cliff"),
    message:
        "Time-conditioned CLiFF-map of {wildcards.dataset}"
    script:
        "../scripts/build_tc_cliff.py"


rule build_stef:
    """STeF-map as periodic functions, and its orientation probabilities in the middle of each hour."""
    input:
        tracks=track_files("train"),
    output:
        spectra=f"results/{RUN}/{{dataset}}/maps/stef.parquet",
        hours=directory(f"results/{RUN}/{{dataset}}/maps/stef"),
    log:
        f"results/{RUN}/logs/build_stef/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_stef/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        options=config["maps"]["stef"],
        timezone=lambda wildcards: DATASETS[wildcards.dataset]["timezone"],
        hours=lambda wildcards: DATASETS[wildcards.dataset]["hours"],
        code=code_of("build_stef"),
    message:
        "STeF-map of {wildcards.dataset}"
    script:
        "../scripts/build_stef.py"


rule build_episodes:
    """Episode map: the training tracks at the time step, to be found by place, heading and speed."""
    input:
        tracks=track_files("train"),
    output:
        f"results/{RUN}/{{dataset}}/maps/episodes.parquet",
    log:
        f"results/{RUN}/logs/build_episodes/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_episodes/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        dataset=lambda wildcards: settings_of(wildcards.dataset, ("time_step_s",)),
        code=code_of("build_episodes"),
    message:
        "Episode map of {wildcards.dataset}"
    script:
        "../scripts/build_episodes.py"


rule build_snippets:
    """Snippet flow map: displacements of a few seconds by cell and heading."""
    input:
        tracks=track_files("train"),
    output:
        f"results/{RUN}/{{dataset}}/maps/snippets.parquet",
    log:
        f"results/{RUN}/logs/build_snippets/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_snippets/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        options=config["maps"]["snippets"],
        dataset=lambda wildcards: settings_of(
            wildcards.dataset, ("time_step_s", "observed_rows")
        ),
        code=code_of("build_snippets"),
    message:
        "Snippet flow map of {wildcards.dataset}"
    script:
        "../scripts/build_snippets.py"


rule build_exits:
    """How likely people leave, by cell and heading."""
    input:
        tracks=track_files("train"),
    output:
        f"results/{RUN}/{{dataset}}/maps/exits.parquet",
    log:
        f"results/{RUN}/logs/build_exits/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/build_exits/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        options=config["maps"]["exits"],
        dataset=lambda wildcards: settings_of(wildcards.dataset, ("time_step_s",)),
        code=code_of("build_exits"),
    message:
        "Ways out of {wildcards.dataset}"
    script:
        "../scripts/build_exits.py"
