# Maps of dynamics from the training recordings: one rule per kind of map, made from its record. And published ones.
#
# INPUTS   clean training tracks; a method's `file`, and clean test tracks, to see that both are of one frame
# OUTPUTS  results/{run}/{dataset}/maps: {kind}.parquet, or {kind}/{hour}.parquet of a kind that has a map per hour;
#          published/{method} likewise
# STEPS    build_{kind}; import_{method} of a method with a `file`

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
        priority: 1  # before trainings and forecasts, so that there are pictures soon
        group:
            "methods"
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


for method in PLAN.published:
    kind, entry = RUN.kind(method), RUN.entries[method]
    file = os.path.join(DATA_ROOT, entry.file)

    rule:
        name:
            f"import_{method}"
        input:
            map=list(map(str, map_files(file))),
            tracks=tracks_of("test"),
        output:
            map=(
                directory(LAYOUT.published_map("{dataset}", method, kind.name))
                if kind.hourly
                else LAYOUT.published_map("{dataset}", method, kind.name)
            ),
        log:
            LAYOUT.log(f"import_{method}", "{dataset}"),
        benchmark:
            LAYOUT.benchmark(f"import_{method}", "{dataset}")
        group:
            "methods"
        resources:
            mem_mb=1500,
            runtime=10,
        params:
            run=RUN.run,
            file=lambda wildcards, file=file: file,  # its braces are no wildcards
            form=entry.form or None,
            kind=kind.name,
            sums={str(one): file_sha256(one) for one in map_files(file)},
            origin_m=lambda wildcards: DATASETS[wildcards.dataset].origin_m,
            dataset=settings_of(*SITE_KEYS),
            code=code_of("import_map", kind.module),
        message:
            f"Map of {{wildcards.dataset}} for {method}, from its file"
        script:
            "../scripts/import_map.py"
