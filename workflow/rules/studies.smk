# Studies: a method with one parameter of its roll-out varied, or with less training data.
#
# INPUTS   clean test tracks, the method's map
# OUTPUTS  results/{run}/{dataset}/studies/{parameter}/{value}.parquet (errors only);
#          results/{run}/{dataset}/studies/training/{method}/{share}.parquet;
#          paper_figures/{run}/parameter-{label}.{csv,pdf,png}, training-share.{csv,pdf,png}
# STEPS    study_parameter, figure_parameters; study_training, figure_training; studies collects them
STUDY = config["studies"]
STUDIED = [
    name for name in ("beta", "sampling_radius_m") if STUDY[name]
]  # an empty list: not studied
THINNED = [name for name in STUDY["training"]["methods"] if name in TITLES]
STUDY_METHOD = {
    "name": STUDY["method"],
    "kind": config["methods"][STUDY["method"]]["kind"],
    "options": method_settings(config, STUDY["method"])["options"],
}


rule study_parameter:
    """Errors of one method on a fixed sample of the test tracks, for every value of one parameter."""
    input:
        tracks=track_files("test"),
        map=lambda wildcards: map_path(
            f"results/{RUN}/{wildcards.dataset}/maps", STUDY_METHOD["kind"]
        ),
    output:
        directory(f"results/{RUN}/{{dataset}}/studies/{{parameter}}"),
    log:
        f"results/{RUN}/logs/study_parameter/{{dataset}}/{{parameter}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/study_parameter/{{dataset}}/{{parameter}}.tsv"
    wildcard_constraints:
        parameter="beta|sampling_radius_m",
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        method=STUDY_METHOD,
        values=lambda wildcards: STUDY[wildcards.parameter],
        max_tracks=STUDY["max_tracks"],
        dataset=lambda wildcards: settings_of(wildcards.dataset, STUDY_KEYS),
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        seeds=config["seeds"],
        code=code_of("study_parameter"),
    message:
        "Study {wildcards.parameter} on {wildcards.dataset}"
    script:
        "../scripts/study_parameter.py"


rule figure_parameters:
    """ADE against beta and against r_s over horizons (the paper's fig:parameter)."""
    input:
        lambda wildcards: expand(
            f"results/{RUN}/{dataset_of_label(wildcards.label)}/studies/{{parameter}}",
            parameter=STUDIED,
        ),
    output:
        csv=f"{EXHIBITS}/parameter-{{label}}.csv",
        pdf=f"{EXHIBITS}/parameter-{{label}}.pdf",
        png=report(
            f"{EXHIBITS}/parameter-{{label}}.png",
            caption="../report/parameter.rst",
            category="Studies",
            labels={"exhibit": "ADE against beta and r_s", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_parameters/{{label}}.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        method=config["methods"][STUDY["method"]]["title"],
        chosen=STUDY_METHOD["options"],
        horizons=config["tables"]["horizons_s"],
        code=code_of("figure_parameters"),
    message:
        "Figure parameter-{wildcards.label}"
    script:
        "../scripts/figure_parameters.py"


rule study_training:
    """Errors of maps that are built from a share of the training tracks."""
    input:
        tracks=track_files("test"),
        training=track_files("train"),
    output:
        directory(f"results/{RUN}/{{dataset}}/studies/training"),
    log:
        f"results/{RUN}/logs/study_training/{{dataset}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/study_training/{{dataset}}.tsv"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        shares=STUDY["training"]["shares"],
        methods=lambda wildcards: [
            {"name": name, **method_of(wildcards.dataset, name)} for name in THINNED
        ],
        max_tracks=STUDY["max_tracks"],
        maps=config["maps"],
        dataset=lambda wildcards: settings_of(wildcards.dataset, STUDY_KEYS),
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        seeds=config["seeds"],
        code=code_of("study_training"),
    message:
        "Study the amount of training data on {wildcards.dataset}"
    script:
        "../scripts/study_training.py"


rule figure_training:
    """ADE against the share of the training tracks."""
    input:
        [f"results/{RUN}/{dataset}/studies/training" for dataset in DATASETS],
    output:
        csv=f"{EXHIBITS}/training-share.csv",
        pdf=f"{EXHIBITS}/training-share.pdf",
        png=report(
            f"{EXHIBITS}/training-share.png",
            caption="../report/training-share.rst",
            category="Studies",
            labels={"exhibit": "amount of training data", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_training.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        datasets=SETTINGS,
        titles=titles_of(THINNED),
        horizons=config["ladder"]["horizons_s"],
        code=code_of("figure_training"),
    message:
        "Figure training-share"
    script:
        "../scripts/figure_training.py"


rule studies:
    """Every study of the run."""
    input:
        expand(rules.figure_parameters.output, label=LABELS if STUDIED else []),
        rules.figure_training.output if THINNED and STUDY["training"]["shares"] else [],
