# Forecasts of every usable test track, to the longest horizon.
#
# INPUTS   clean test recordings; the map of the method, if it has one
# OUTPUTS  results/{run}/{dataset}/forecasts/{method}/{recording}.parquet
# STEPS    forecast_method; average_forecasts for methods that are the mean of others
#
# One job forecasts all recordings of a dataset, since starting up takes longer than most recordings.


rule forecast_method:
    """k futures of each usable track of every test recording, for every seed."""
    input:
        tracks=track_files("test"),
        map=method_map,
        exits=method_exits,
    output:
        directory(f"results/{RUN}/{{dataset}}/forecasts/{{method}}"),
    log:
        f"results/{RUN}/logs/forecast_method/{{dataset}}/{{method}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/forecast_method/{{dataset}}/{{method}}.tsv"
    wildcard_constraints:
        method="|".join(name for name in METHODS if name not in LEARNED + AVERAGES)
        or NO_METHOD,
    resources:
        mem_mb=1500,
        runtime=120,
    params:
        method=lambda wildcards: method_of(wildcards.dataset, wildcards.method),
        dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        seeds=config["seeds"],
        code=code_of("forecast_method"),
    message:
        "Forecast {wildcards.dataset} with {wildcards.method}"
    script:
        "../scripts/forecast_method.py"


rule average_forecasts:
    """The mean of other methods' paths, as a method of its own."""
    input:
        lambda wildcards: [
            f"results/{RUN}/{wildcards.dataset}/forecasts/{name}"
            for name in members(config, wildcards.method)
        ],
    output:
        directory(f"results/{RUN}/{{dataset}}/forecasts/{{method}}"),
    log:
        f"results/{RUN}/logs/average_forecasts/{{dataset}}/{{method}}.log",
    wildcard_constraints:
        method="|".join(AVERAGES) or NO_METHOD,
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        code=code_of("average_forecasts"),
    message:
        "Average forecasts of {wildcards.dataset} as {wildcards.method}"
    script:
        "../scripts/average_forecasts.py"
