"""Rule take_forecasts."""

from pathlib import Path

from modlhmp.exchange.hand_in import read_hand_in
from modlhmp.exchange.task import make_task
from modlhmp.forecasting.files import STORED, write_forecasts
from modlhmp.forecasting.outputs import kept
from modlhmp.forecasting.windows import windows
from modlhmp.logs import job_log
from modlhmp.origins import provenance, unchanged
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.study.layout import Layout
from modlhmp.tracks import owner_ids, read_tracks

with job_log(snakemake.log[0]) as log:
    params, names = snakemake.params, snakemake.wildcards
    layout = Layout.around(params.run, snakemake.output[0])
    site, files = build(Site, params.dataset), snakemake.input.files
    own = {name: layout.tracks(names.dataset, name) for name in params.recordings}
    tested = ((name, read_tracks(file), read_scenes(file), None) for name, file in own.items())
    task = make_task(tested, site, names.dataset)
    with unchanged(*files) as hashes:
        hand_in = read_hand_in(Path(files[0]).parent, task)
    (log.warning if len(hand_in.missing) else log.info)("%s", hand_in.coverage())
    for recording, file in own.items():
        forecasts = ((seed, ids, kept(one, STORED)) for seed, ids, one in hand_in.forecasts(recording))
        origin = provenance({**names, "recording": recording}, dict(params), [file, *files], hashes)
        wanted = windows(read_tracks(file), site, read_scenes(file))
        write_forecasts(
            layout.forecast(names.dataset, names.method, recording), forecasts, wanted.t0 if wanted.several else None,
            owner_ids(file), **origin, alike=hand_in.samples.alike,
        )  # fmt: skip
