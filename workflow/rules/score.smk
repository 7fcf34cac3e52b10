# Errors of every forecast under both protocols, and what they say.
#
# INPUTS   clean test tracks and forecasts
# OUTPUTS  results/{run}/{dataset}/errors/{method}.parquet, ttests.parquet; paper_figures/{run}/results.csv
# STEPS    score_method, compare_methods, summarise_results


rule score_method:
    """ADE and FDE at every horizon of each test track and seed, under both protocols."""
    input:
        tracks=track_files("test"),
        forecasts=lambda wildcards: [
            f"results/{RUN}/{wildcards.dataset}/forecasts/{wildcards.method}/{r['name']}.parquet"
            for r in recordings(wildcards.dataset, "test")
        ],
        floor_plan=lambda wildcards: DATASETS[wildcards.dataset]["floor_plan"],
    output:
        f"results/{RUN}/{{dataset}}/errors/{{method}}.parquet",
    log:
        f"results/{RUN}/logs/score_method/{{dataset}}/{{method}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/score_method/{{dataset}}/{{method}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        dataset=lambda wildcards: settings_of(wildcards.dataset, SCORE_KEYS),
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        code=code_of("score_method"),
    message:
        "Score {wildcards.method} on {wildcards.dataset}"
    script:
        "../scripts/score_method.py"


rule compare_methods:
    """Paired one-sided t-tests between methods on the same tracks."""
    input:
        [f"results/{RUN}/{{dataset}}/errors/{method}.parquet" for method in TITLES],
    output:
        f"results/{RUN}/{{dataset}}/ttests.parquet",
    log:
        f"results/{RUN}/logs/compare_methods/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/compare_methods/{{dataset}}.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        dataset=lambda wildcards: settings_of(
            wildcards.dataset, ("name", "time_step_s", "horizon_s")
        ),
        pairs=[pair for pair in config["comparisons"] if set(pair) <= set(TITLES)],
        horizons=config["tables"]["horizons_s"],
        code=code_of("compare_methods"),
    message:
        "Compare the methods on {wildcards.dataset}"
    script:
        "../scripts/compare_methods.py"


rule summarise_results:
    """Every score of a run in long form."""
    input:
        [
            f"results/{RUN}/{dataset}/errors/{method}.parquet"
            for dataset in DATASETS
            for method in TITLES
        ],
    output:
        f"{EXHIBITS}/results.csv",
    log:
        f"results/{RUN}/logs/summarise_results.log",
    benchmark:
        f"results/{RUN}/benchmarks/summarise_results.tsv"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        time_steps={name: dataset["time_step_s"] for name, dataset in DATASETS.items()},
        code=code_of("summarise_results"),
    message:
        "All scores of run {RUN}"
    script:
        "../scripts/summarise_results.py"
