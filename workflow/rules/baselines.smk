# The learned baselines: trained once a dataset, then forecasting like any other method.
#
# INPUTS   clean training tracks, and those of everyone else who was there on the same days
# OUTPUTS  results/{run}/{dataset}/models/{method}.{pt,json}, forecasts/{method}/{recording}.parquet
# STEPS    train_{method}; forecast_with_network

for method in LEARNED:

    rule:
        name:
            f"train_{method}"
        input:
            tracks=lambda wildcards: expand(
                f"results/{RUN}/{{dataset}}/tracks/{{name}}.parquet",
                dataset=wildcards.dataset,
                name=people(wildcards.dataset, "train"),
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
            method=lambda wildcards, method=method: method_of(wildcards.dataset, method),
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
    """Futures of each usable track of every test recording; whoever was there on its day is seen as well."""
    input:
        tracks=lambda wildcards: expand(
            f"results/{RUN}/{{dataset}}/tracks/{{name}}.parquet",
            dataset=wildcards.dataset,
            name=people(wildcards.dataset, "test"),
        ),
        weights=f"results/{RUN}/{{dataset}}/models/{{method}}.pt",
        summary=f"results/{RUN}/{{dataset}}/models/{{method}}.json",
    output:
        directory(f"results/{RUN}/{{dataset}}/forecasts/{{method}}"),
    log:
        f"results/{RUN}/logs/forecast_with_network/{{dataset}}/{{method}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/forecast_with_network/{{dataset}}/{{method}}.tsv"
    wildcard_constraints:
        method="|".join(LEARNED) or NO_METHOD,
    threads: config["learned"]["threads"]
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        method=lambda wildcards: method_of(wildcards.dataset, wildcards.method),
        dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
        recordings=lambda wildcards: {
            r["name"]: same_day(wildcards.dataset, r["name"])
            for r in recordings(wildcards.dataset, "test")
        },
        seeds=config["seeds"],
        code=lambda wildcards: network_code("forecast_with_network", wildcards.method),
    message:
        "Forecast {wildcards.dataset} with {wildcards.method}"
    script:
        "../scripts/forecast_with_network.py"
