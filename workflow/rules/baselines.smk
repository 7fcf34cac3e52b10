# The learned baselines: trained once a dataset, then forecasting like any other method.
#
# INPUTS   clean training tracks, and those of everyone else who was there on the same days
# OUTPUTS  results/{run}/{dataset}/models/{method}.{pt,json}, forecasts/{method}/{recording}.parquet
# STEPS    train_{method}, one rule a learned method; forecast_with_network

for method in LEARNED:

    rule:
        name:
            f"train_{method}"
        input:
            tracks=lambda wildcards: expand(
                f"results/{RUN}/{{dataset}}/tracks/{{name}}.parquet",
                dataset=wildcards.dataset,
                name=TRAINING_PEOPLE[wildcards.dataset],
            ),
        output:
            weights=f"results/{RUN}/{{dataset}}/models/{method}.pt",
            summary=f"results/{RUN}/{{dataset}}/models/{method}.json",
        log:
            f"results/{RUN}/logs/train/{{dataset}}/{method}.log",
        benchmark:
            f"results/{RUN}/benchmarks/train/{{dataset}}/{method}.tsv"
        threads: config["learned"]["threads"]
        resources:
            mem_mb=3000,
            runtime=24 * 60,
        params:
            name=method,
            method=METHODS[method],
            dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
            days=lambda wildcards: {
                r["name"]: same_day(wildcards.dataset, r["name"])
                for r in recordings(wildcards.dataset, "train")
            },
            code=network_code("train_network", method),
        message:
            f"Train {METHODS[method]['kind']} as {method} on {{wildcards.dataset}}"
        script:
            "../scripts/train_network.py"


rule forecast_with_network:
    """Futures of each usable track of a test recording from a trained network."""
    input:
        tracks=f"results/{RUN}/{{dataset}}/tracks/{{recording}}.parquet",
        others=lambda wildcards: expand(
            f"results/{RUN}/{{dataset}}/tracks/{{name}}.parquet",
            dataset=wildcards.dataset,
            name=same_day(wildcards.dataset, wildcards.recording),
        ),
        weights=f"results/{RUN}/{{dataset}}/models/{{method}}.pt",
        summary=f"results/{RUN}/{{dataset}}/models/{{method}}.json",
    output:
        f"results/{RUN}/{{dataset}}/forecasts/{{method}}/{{recording}}.parquet",
    log:
        f"results/{RUN}/logs/forecast_with_network/{{dataset}}/{{method}}/{{recording}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/forecast_with_network/{{dataset}}/{{method}}/{{recording}}.tsv"
    wildcard_constraints:
        method="|".join(LEARNED) or NO_METHOD,
    threads: config["learned"]["threads"]
    resources:
        mem_mb=3000,
        runtime=120,
    params:
        method=lambda wildcards: METHODS[wildcards.method],
        dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
        seeds=config["seeds"],
        code=lambda wildcards: network_code("forecast_with_network", wildcards.method),
    message:
        "Forecast {wildcards.dataset} {wildcards.recording} with {wildcards.method}"
    script:
        "../scripts/forecast_with_network.py"
