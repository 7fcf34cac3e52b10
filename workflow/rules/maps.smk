# Maps of dynamics from the training recordings: one rule per kind of map, made from its record.
#
# INPUTS   clean training tracks
# OUTPUTS  results/{run}/{dataset}/maps: {kind}.parquet, or {kind}/{hour}.parquet of a kind that has a map per hour
# STEPS    build_{kind}

for kind in all_kinds().values():
    if not kind.has_map:
        continue

    rule:
        name:
            f"build_{kind.name}"
        input:
            tracks=tracks_of("train"),
        output:
            map=(
                directory(LAYOUT.map("{dataset}", kind.name))
                if kind.hourly
                else LAYOUT.map("{dataset}", kind.name)
            ),
        log:
            LAYOUT.log(f"build_{kind.name}", "{dataset}"),
        benchmark:
            LAYOUT.benchmark(f"build_{kind.name}", "{dataset}")
        resources:
            mem_mb=1500,
            runtime=60,
        params:
            kind=kind.name,
            building=as_plain(RUN.building(kind)),
            dataset=settings_of(*SITE_KEYS),
            code=code_of("build_map", kind.module),
        message:
            f"{kind.title} map of {{wildcards.dataset}}"
        script:
            "../scripts/build_map.py"
