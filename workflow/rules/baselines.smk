# The learned baselines: trained once a dataset, then forecasting like any other method.
#
# INPUTS   clean training tracks, and those of everyone else who was there on the same days
# OUTPUTS  results/{run}/{dataset}/models/{method}.{pt,json}, forecasts/{method}/{recording}.parquet
# STEPS    train_{method}; forecast_{method}_on_{dataset}

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


# One job forecasts all recordings, since loading PyTorch takes longer than most forecasts. Its outputs are as many as
# the dataset has test recordings, so it is a rule a dataset and method.
for dataset in DATASETS:
    for method in LEARNED:

        rule:
            name:
                f"forecast_{method}_on_{dataset}"
            input:
                tracks=expand(
                    f"results/{RUN}/{dataset}/tracks/{{name}}.parquet",
                    name=people(dataset, "test"),
                ),
                weights=f"results/{RUN}/{dataset}/models/{method}.pt",
                summary=f"results/{RUN}/{dataset}/models/{method}.json",
            output:
                expand(
                    f"results/{RUN}/{dataset}/forecasts/{method}/{{name}}.parquet",
                    name=[r["name"] for r in recordings(dataset, "test")],
                ),
            log:
                f"results/{RUN}/logs/forecast_with_network/{dataset}/{method}.log",
            benchmark:
                f"results/{RUN}/benchmarks/forecast_with_network/{dataset}/{method}.tsv"
            threads: config["learned"]["threads"]
            resources:
                mem_mb=3000,
                runtime=240,
            params:
                dataset_name=dataset,
                method_name=method,
                method=METHODS[method],
                dataset=settings_of(dataset, FORECAST_KEYS),
                recordings={
                    r["name"]: same_day(dataset, r["name"])
                    for r in recordings(dataset, "test")
                },
                seeds=config["seeds"],
                code=network_code("forecast_with_network", method),
            message:
                f"Forecast {dataset} with {method}"
            script:
                "../scripts/forecast_with_network.py"
