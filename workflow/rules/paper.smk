# The exhibits, named after the paper's labels.
#
# INPUTS   paper_figures/{run}/results.csv, the t-tests, the maps
# OUTPUTS  paper_figures/{run}/<label>.{csv,tex,md,html} for tables, .{pdf,png,csv} for figures
# STEPS    table_parameters, table_results, table_ttests, table_claims, figure_horizon_errors, figure_ranking,
#          figure_coverage; tables, figures collect them


rule table_parameters:
    """Parameters of the experiment, with the 90th percentile of track length."""
    input:
        tracks=[
            f"results/{RUN}/{name}/tracks/{r['name']}.parquet"
            for name in DATASETS
            for r in recordings(name, "test")
        ],
    output:
        **table_files("tab_scenarios"),
    log:
        f"results/{RUN}/logs/table_parameters.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        rollout=config["rollout"],
        maps=config["maps"],
        code=code_of("table_parameters"),
    message:
        "Table of parameters"
    script:
        "../scripts/table_parameters.py"


rule table_results:
    """ADE and FDE of every method and dataset under both protocols."""
    input:
        results=rules.summarise_results.output[0],
    output:
        **table_files("tab_expres"),
    log:
        f"results/{RUN}/logs/table_results.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        horizons=config["tables"]["horizons_s"],
        code=code_of("table_results"),
    message:
        "Table of results"
    script:
        "../scripts/table_results.py"


rule table_ttests:
    """All paired t-tests."""
    input:
        [f"results/{RUN}/{name}/ttests.parquet" for name in DATASETS],
    output:
        **table_files("tab_ttests"),
    log:
        f"results/{RUN}/logs/table_ttests.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        code=code_of("table_ttests"),
    message:
        "Table of t-tests"
    script:
        "../scripts/table_ttests.py"


rule table_claims:
    """Every claim of the paper's results section beside our test of it."""
    input:
        tracks=rules.table_parameters.input.tracks,
        errors=rules.summarise_results.input,
        studies=expand(
            f"results/{RUN}/{{dataset}}/studies/{{parameter}}",
            dataset=DATASETS,
            parameter=STUDIED if STUDY["method"] == "tc_cliff" else [],
        ),
        runtime=measured_runtimes,
    output:
        **table_files("claims"),
    log:
        f"results/{RUN}/logs/table_claims.log",
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        datasets=SETTINGS,
        titles=TITLES,
        kinds={name: METHODS[name]["kind"] for name in TITLES},
        horizons=config["tables"]["horizons_s"],
        code=code_of("table_claims"),
    message:
        "Table of claims"
    script:
        "../scripts/table_claims.py"


rule figure_horizon_errors:
    """ADE and FDE against the horizon (the paper's fig:atc_final and fig:edin_final)."""
    input:
        results=rules.summarise_results.output[0],
    output:
        csv=f"{EXHIBITS}/{{label}}_final.csv",
        pdf=f"{EXHIBITS}/{{label}}_final.pdf",
        png=report(
            f"{EXHIBITS}/{{label}}_final.png",
            caption="../report/final.rst",
            category="Figures",
            labels={"exhibit": "errors against horizon", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_horizon_errors/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        methods=TITLES,
        code=code_of("figure_horizon_errors"),
    message:
        "Figure {wildcards.label}_final"
    script:
        "../scripts/figure_horizon_errors.py"


rule figure_ranking:
    """TC-CLiFF with and without ranking (the paper's fig:rank-metrics)."""
    input:
        results=rules.summarise_results.output[0],
    output:
        csv=f"{EXHIBITS}/rank-metrics.csv",
        pdf=f"{EXHIBITS}/rank-metrics.pdf",
        png=report(
            f"{EXHIBITS}/rank-metrics.png",
            caption="../report/rank-metrics.rst",
            category="Figures",
            labels={"exhibit": "with and without ranking", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_ranking.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        title=config["methods"]["tc_cliff"]["title"],
        code=code_of("figure_ranking"),
    message:
        "Figure rank-metrics"
    script:
        "../scripts/figure_ranking.py"


rule figure_coverage:
    """What share of the eligible tracks each method scores at each horizon."""
    input:
        results=rules.summarise_results.output[0],
    output:
        csv=f"{EXHIBITS}/coverage.csv",
        pdf=f"{EXHIBITS}/coverage.pdf",
        png=report(
            f"{EXHIBITS}/coverage.png",
            caption="../report/coverage.rst",
            category="Figures",
            labels={"exhibit": "coverage", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_coverage.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        code=code_of("figure_coverage"),
    message:
        "Figure coverage"
    script:
        "../scripts/figure_coverage.py"


rule tables:
    """Every table of the run."""
    input:
        rules.summarise_results.output,
        rules.table_parameters.output,
        rules.table_results.output,
        rules.table_ttests.output,
        rules.table_claims.output,
        MODEL_TABLES,
        UNCERTAINTY_TABLES,
        [] if not RUNGS else expand(rules.table_ladder.output, label=LABELS),


rule figures:
    """Every figure of the run."""
    input:
        expand(rules.figure_horizon_errors.output, label=LABELS),
        MAP_FIGURES,
        FORECAST_FIGURES,
        MODEL_FIGURES,
        UNCERTAINTY_FIGURES,
        rules.figure_ladder.output if RUNGS else [],
        rules.figure_coverage.output,
        rules.figure_runtime.output if measured_runtimes(None) else [],
        rules.figure_ranking.output if "tc_cliff" in TITLES else [],
