"""Errors are gathered recording by recording, and give to the last bit what one table of all in memory gives."""

import tracemalloc

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from modlhmp.scoring.errors import nan_mean, seed_mean
from modlhmp.scoring.ttests import paired_test
from modlhmp.storage import write_pieces
from modlhmp.study.comparisons import compare
from modlhmp.study.csv_cells import csv_text
from modlhmp.study.summary import (
    COLUMNS,
    NAMES,
    Errors,
    at_horizons,
    at_own_length,
    read_errors,
    read_scores,
    sample_sd,
    summarise,
)

STEPS = 12
# In the order of the alphabet "day/..." comes after "day.x/...", though "day" comes before "day.x".
RECORDINGS = ("day", "day.x", "b", "day-2", "a2", "a10")


def recording(name, rng, seeds=(0, 1, 2), tracks=9, walls=False, outputs=("ranked", "mean"), protocols=("paper",)):
    """Rows of errors of one recording, as `score_recording` has them; a third is not scored."""
    parts = []
    for seed in seeds:
        ids = rng.choice(40, tracks, replace=False)  # not the same tracks with every seed
        length = 1 + (ids * 7) % (STEPS + 3)
        for output in outputs:
            for protocol in protocols:
                ade = rng.gamma(2.0, 3.0, (tracks, STEPS)).astype(np.float32)
                ade[(np.arange(STEPS) >= length[:, None]) | (rng.random(ade.shape) < 1 / 3)] = np.nan
                one = {
                    **{k: pa.array([v] * tracks).dictionary_encode() for k, v in
                       {"recording": name, "output": output, "protocol": protocol}.items()},
                    "track_id": ids, "alive_steps": (ids % 5).astype(np.int32),
                    "seed": np.full(tracks, seed, np.int32),
                    "eligible_steps": np.minimum(length, STEPS).astype(np.int32),
                    "person": pa.array([f"p{i // 2}" for i in ids]).dictionary_encode(),
                    "ade": lists(ade), "fde": lists(2 * ade),
                }  # fmt: skip
                if walls:
                    one["infeasible"] = lists(np.where(np.isfinite(ade), rng.random(ade.shape) < 0.3, np.nan))
                    one["truth_infeasible_from"] = (ids % 4).astype(np.int32)
                parts.append(pa.table(one))
    return pa.concat_tables(parts).unify_dictionaries()


def lists(values):
    return pa.FixedSizeListArray.from_arrays(pa.array(values.astype(np.float32).ravel()), values.shape[1])


def whole(path):
    """{(output, protocol): `Errors`} from all rows at once, tracks in the order of their keys."""
    rows, found = pq.read_table(path).to_pandas(), {}
    for key, group in rows.groupby(["output", "protocol"], observed=True):
        of = group["recording"].astype(str) + "/"
        keys, first, track = np.unique(of + group["track_id"].astype(str), return_index=True, return_inverse=True)
        seeds, seed = np.unique(group["seed"], return_inverse=True)
        arrays = {}
        for name in (one for one in ("ade", "fde", "infeasible") if one in group):
            arrays[name] = np.full((len(seeds), len(keys), STEPS), np.nan, np.float32)
            arrays[name][seed, track] = np.stack(group[name])
        eligible, unknown = np.zeros(len(keys), int), np.zeros(len(keys), bool)
        eligible[track] = group["eligible_steps"]
        unknown[track[group["alive_steps"] == 0]] = True
        if "infeasible" in group:
            since = np.zeros(len(keys), int)
            since[track] = group["truth_infeasible_from"]
            arrays["truth_infeasible"] = (since[:, None] > 0) & (np.arange(1, STEPS + 1) >= since[:, None])
        person = (of + group["person"].astype(str)).to_numpy(str)[first]
        found[key] = Errors(keys, eligible_steps=eligible, unknown=unknown, person=person, **arrays)
    return found


def whole_summary(errors):
    """The rows of `summarise` from whole arrays [seeds, tracks, T]."""
    rows = []
    for key, one in sorted(errors.items()):
        scored = np.isfinite(one.ade)
        own = [at_own_length(each, one.eligible_steps) for each in (one.ade, one.fde, scored.astype(float))]
        walls = truth = np.full(STEPS, np.nan)
        if one.infeasible is not None:
            walls, truth = seed_mean(one.infeasible), seed_mean(np.where(scored, one.truth_infeasible, np.nan))
        columns = [
            seed_mean(one.ade), seed_mean(one.fde),
            *([sample_sd(values[:, step]) for step in range(STEPS)] for values in (
                nan_mean(one.ade, axis=0), nan_mean(one.fde, axis=0), nan_mean(one.ade, axis=1))),
            scored.sum(axis=1).mean(axis=0),
            [(one.eligible_steps > step).sum() for step in range(STEPS)], [len(one.ade)] * STEPS,
            *(seed_mean(np.where(scored.all(axis=0), each, np.nan)) for each in (one.ade, one.fde)),
            scored.all(axis=0).sum(axis=0), *(seed_mean(each) for each in own[:2]),
            np.nansum(own[2], axis=1).mean(axis=0), walls, truth,
        ]  # fmt: skip
        rows += [("d", "m", *key, step + 1.0, *(column[step] for column in columns)) for step in range(STEPS)]
    return pd.DataFrame(rows, columns=COLUMNS)


@pytest.fixture(params=["a recording a piece", "pieces across recordings", "one piece", "walls", "one track"])
def path(request, tmp_path):
    rng = np.random.default_rng(5)
    more = {"walls": {"walls": True}, "one track": {"tracks": 1, "seeds": (4,)}}.get(request.param, {})
    parts = [recording(name, rng, protocols=("paper", "complete"), **more) for name in RECORDINGS]
    if request.param in {"pieces across recordings", "one piece"}:
        table = pa.concat_tables(parts).unify_dictionaries()
        size = 23 if request.param == "pieces across recordings" else len(table)
        parts = [table.slice(start, size) for start in range(0, len(table), size)]
    write_pieces(parts, tmp_path / "errors.parquet")
    return tmp_path / "errors.parquet"


def same(found, wanted):
    for name, one, other in zip(Errors._fields, found, wanted, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name, strict=name not in {"keys", "person"})


def test_errors_are_those_of_the_whole_table(path):
    found, wanted = read_errors(path), whole(path)
    assert set(found) == set(wanted)
    assert len(found) == len(wanted)
    for key in wanted:
        same(found[key], wanted[key])


def test_the_summary_is_to_the_last_bit_that_of_the_whole_table(path):
    wanted = whole_summary(whole(path))
    pd.testing.assert_frame_equal(summarise("d", "m", read_errors(path), 1.0), wanted, check_exact=True)
    pd.testing.assert_frame_equal(summarise("d", "m", whole(path), 1.0), wanted, check_exact=True)


def test_a_recording_without_a_seed_or_an_output_leaves_a_gap(tmp_path):
    rng, path = np.random.default_rng(6), tmp_path / "errors.parquet"
    write_pieces([recording("all", rng), recording("few", rng, seeds=(1,), outputs=("ranked",))], path)
    found = read_errors(path)
    few = [key.startswith("few/") for key in found["ranked", "paper"].keys]
    assert np.isnan(found["ranked", "paper"].ade[[0, 2]][:, few]).all()
    assert not any(key.startswith("few/") for key in found["mean", "paper"].keys)
    pd.testing.assert_frame_equal(summarise("d", "m", found, 1.0), whole_summary(whole(path)), check_exact=True)


def test_tests_between_methods_are_those_of_whole_tables(tmp_path):
    rng, horizons, files = np.random.default_rng(7), [2.0, 9.0], {}
    for method in ("one", "two", "three"):
        files[method] = tmp_path / f"{method}.parquet"
        write_pieces([recording(name, rng, protocols=("paper", "complete")) for name in RECORDINGS], files[method])
    pairs = [("one", "two"), ("one", "three"), ("three", "two")]
    days = {name: name for name in RECORDINGS}
    tests = compare(
        "d", {name: at_horizons(file, horizons, 1.0) for name, file in files.items()}, pairs, horizons, days
    )
    for row in tests.itertuples():
        one, other = (whole(files[name])["ranked", row.protocol] for name in (row.method, row.against))
        _, at, at_other = np.intersect1d(one.keys, other.keys, return_indices=True)
        step = int(row.horizon_s) - 1
        ours = getattr(one, row.metric)[:, at, step]
        theirs = getattr(other, row.metric)[:, at_other, step]
        neither = np.isnan(ours) | np.isnan(theirs)
        ours[neither] = theirs[neither] = np.nan
        wanted = paired_test(ours, theirs, [key.rpartition("/")[0] for key in one.keys[at]])
        found = row.n, row.clusters, row.mean_difference_m, row.ci_low_m, row.ci_high_m, row.effect_size, row.t, row.p
        np.testing.assert_array_equal(found, wanted[: len(found)])


def test_memory_grows_with_a_recording_not_with_their_number(tmp_path):
    """But for the means per track over the seeds, of one output and protocol after the other."""

    def peak(number):
        rng, path = np.random.default_rng(8), tmp_path / f"{number}.parquet"
        write_pieces((recording(f"day{n}", rng, range(12), 40, outputs=("ranked",)) for n in range(number)), path)
        summarise("d", "m", read_errors(path), 1.0)  # what is loaded once is loaded
        tracemalloc.start()
        summarise("d", "m", read_errors(path), 1.0)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    few, many = peak(3), peak(18)
    means = 15 * 40 * STEPS * 8 * 2  # of every further track, float64, ADE and FDE
    all_in_memory = 15 * 40 * STEPS * 4 * 2 * 12  # the errors themselves, with 12 seeds
    assert many - few < 2 * means < all_in_memory / 2


def test_scores_are_read_as_they_were_written(tmp_path):
    """Whatever the names look like: numbers, what tables write for nothing, what a spreadsheet would run."""
    texts = ["20121024", "007", "1e5", "1.50", "NA", "null", "nan", "None", "True", "-x", "=1", "a b,c", "zurich"]
    table = pd.DataFrame(dict.fromkeys(NAMES, texts))
    numbers = [name for name in COLUMNS if name not in NAMES]
    table[numbers] = np.arange(len(texts) * len(numbers)).reshape(len(texts), -1) / 8
    table.loc[3, "ade_m"] = np.nan
    (tmp_path / "results.csv").write_text(csv_text(table[list(COLUMNS)]))
    pd.testing.assert_frame_equal(read_scores(tmp_path / "results.csv"), table[list(COLUMNS)], check_dtype=False)
