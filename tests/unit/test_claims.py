"""The table of claims: verdicts by hand on planted differences, and claims that cannot be tested yet."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from modlhmp.datasets import Dataset
from modlhmp.study import claims
from modlhmp.study.comparisons import compare
from modlhmp.study.exhibits.claims_table import write_claims
from modlhmp.study.summary import Errors

HALL = Dataset(title="Hall", label="atc", name="hall", reader="atc", horizon_s=60, time_step_s=1.0, demo=True)
TITLES = {"tc_cliff": "TC-CLiFF", "cliff": "CLiFF", "stef": "STeF", "cvm": "CVM", "lstm": "LSTM"}
KINDS = {name: name for name in TITLES}
HORIZONS = [5, 10, 30.0, 60]


def errors_of(mean, outputs=("ranked", "mean"), tracks=200, seed=0, spread=0.5):
    """Errors [1, tracks, horizons] around a mean per horizon."""
    rng = np.random.default_rng(seed)
    ade = np.asarray(mean, float) + rng.normal(0, spread, (1, tracks, len(HORIZONS)))
    keys = np.array([f"day/{n:03d}" for n in range(tracks)])
    return {
        (output, protocol): Errors(keys, ade, 2 * ade, np.full(tracks, 60), np.zeros(tracks, bool), keys)
        for output in outputs
        for protocol in ("paper", "complete")
    }


def evidence(**changes):
    """Four methods: TC-CLiFF better than CLiFF everywhere, STeF better than both at 60 s."""
    known = {
        "dataset": HALL, "horizons": HORIZONS, "studies": {}, "lengths": np.linspace(1, 100, 300), "runtime": None,
        "idle": frozenset(), "days": {"day": "2030-01-01"},
        "errors": {
            "tc_cliff": errors_of([1, 2, 4, 8]), "cliff": errors_of([1.5, 2.5, 4.5, 8.5], seed=1),
            "stef": errors_of([2, 3, 5, 7], seed=2), "cvm": errors_of([2, 4, 10, 20], ("single",), seed=3),
        },
    }  # fmt: skip
    known |= changes
    pairs = [pair for pair in claims.claimed_pairs(KINDS) if set(pair) <= known["errors"].keys()]
    known.setdefault("tests", compare("hall", known["errors"], pairs, HORIZONS, known["days"]))
    return claims.Evidence(**known)


def verdicts(table, text):
    """Verdicts of the rows whose test holds `text`."""
    return set(table[table["our test"].str.contains(text, regex=False)]["verdict"])


def test_planted_differences_get_their_verdicts():
    table = claims.test_claims([evidence()], TITLES, KINDS)
    assert verdicts(table, "ADE TC-CLiFF < CLiFF, 60 s") == {"supported"}
    counted = table[table["our test"].str.contains("lower at every horizon")]
    assert set(counted["verdict"]) == {"counted, not tested"}  # means without a test are no verdict
    assert set(counted["measured"]) == {"at 4 of 4"}
    assert verdicts(table, "ADE TC-CLiFF < STeF, 60 s") == {"contradicted"}
    row = table[table["our test"] == "ADE TC-CLiFF < CLiFF, 60 s"].iloc[0]
    assert row["n"] == 200
    assert row["mean difference"] == pytest.approx(-0.5, abs=0.15)
    assert row["measured"].startswith(("7.9", "8.0"))


def test_what_cannot_be_tested_says_so():
    table = claims.test_claims([evidence()], TITLES, KINDS)
    untested = table[table["verdict"] == "not tested"]
    assert set(untested["our test"]) >= {"needs learned methods (none is compared here)", "needs a floor plan"}
    assert (table["verdict"] != "").all()
    assert set(table["claim"]) == {claim.text for claim in claims.CLAIMS.values() if "atc" in claim.labels}


def test_one_method_only():
    """No crash: every comparison is named as missing."""
    table = claims.test_claims([evidence(errors={"cvm": errors_of([1, 2, 3, 4], ("single",))})], TITLES, KINDS)
    assert set(table["verdict"]) <= {"not tested", "contradicted"}
    assert verdicts(table, "needs tc_cliff, cliff among") == {"not tested"}


def test_half_of_a_network_s_error():
    """`over 50 % better` is a test against half the network's error."""
    errors = {**evidence().errors, "lstm": errors_of([1, 1.8, 9, 18], ("single",), seed=4)}
    table = claims.test_claims([evidence(errors=errors)], TITLES, KINDS)
    assert verdicts(table, "ADE TC-CLiFF < 0.5 × LSTM, 60 s") == {"supported"}
    assert verdicts(table, "ADE LSTM < TC-CLiFF, 10 s") == {"supported"}
    errors["lstm"] = errors_of([1, 1.8, 9, 14], ("single",), seed=4)  # half of it is 7, TC-CLiFF has 8
    table = claims.test_claims([evidence(errors=errors)], TITLES, KINDS)
    assert verdicts(table, "ADE TC-CLiFF < 0.5 × LSTM, 60 s") == {"contradicted"}


def test_who_idles_is_told_apart():
    """The network gains 3 m of FDE on the 50 tracks that idle and loses 0.5 m on the others."""
    keys = errors_of([1, 2, 4, 8])["ranked", "paper"].keys
    gain = np.where(np.arange(len(keys)) < 50, -1.5, 0.25)[None, :, None]
    lstm = {key: one._replace(ade=one.ade + gain, fde=one.fde + 2 * gain)
            for key, one in errors_of([1, 2, 4, 8], ("single",), seed=4).items()}  # fmt: skip
    known = {"errors": {**evidence().errors, "lstm": lstm}, "dataset": dataclasses.replace(HALL, label="edin")}
    table = claims.test_claims([evidence(idle=frozenset(keys[:50]), **known)], TITLES, KINDS)
    row = table[table["our test"].str.contains("those who idle")].iloc[0]
    assert row["verdict"] == "supported"
    assert row["mean difference"] == pytest.approx(-3.5, abs=0.4)
    assert row["measured"].endswith("(n 150)")
    table = claims.test_claims([evidence(idle=frozenset(keys[:1]), **known)], TITLES, KINDS)
    assert verdicts(table, "those who idle") == {"too few tracks"}


def test_gain_of_ranking_grows():
    """Ranked is better by 0.1 m at 30 s and by 1 m at 60 s."""
    mean = errors_of([1, 2, 4, 8])
    ranked = {
        ("ranked", protocol): one._replace(ade=one.ade - [0, 0, 0.1, 1.0])
        for (output, protocol), one in errors_of([1, 2, 4, 8], seed=0).items()
        if output == "ranked"
    }
    errors = {"tc_cliff": {**mean, **ranked}}
    noise = np.random.default_rng(5).normal(0, 0.3, (1, 200, 4))
    errors["tc_cliff"] |= {key: one._replace(ade=one.ade + noise) for key, one in ranked.items()}
    table = claims.test_claims([evidence(errors=errors)], TITLES, KINDS)
    assert verdicts(table, "gain at 60 s > gain at 30 s") == {"supported"}
    assert verdicts(table, "ADE ranked < mean of the k, 60 s") == {"supported"}


def test_studies_are_compared_by_value():
    """β = 1 best: lower β is contradicted; r_s = 1 best: supported."""
    study = {value: errors_of([1, 2, 4, base], seed=int(10 * value)) for value, base in ((0.1, 20), (1, 8), (10, 9))}
    radius = {value: errors_of([1, 2, 4, base], seed=int(7 * value)) for value, base in ((0.5, 12), (1, 8), (3, 9))}
    table = claims.test_claims([evidence(studies={"beta": study, "sampling_radius_m": radius})], TITLES, KINDS)
    assert verdicts(table, "β = 0.1 < β = 10") == {"contradicted"}
    assert verdicts(table, "β = 0.1 < β = 1, ") == {"contradicted"}
    assert verdicts(table, "r_s = 1 < r_s = 0.5") == verdicts(table, "r_s = 1 < r_s = 3") == {"supported"}


def test_the_percentile_has_an_interval():
    """Lengths 1..100: the 90th percentile is 90, not the paper's 60; a sample around it supports 60."""
    table = claims.test_claims([evidence()], TITLES, KINDS)
    row = table[table["our test"].str.startswith("90th")].iloc[0]
    assert row["verdict"] == "contradicted"
    assert row["measured"] == "90.1 s"
    close = evidence(lengths=np.random.default_rng(0).uniform(0, 60 / 0.9, 400))
    assert verdicts(claims.test_claims([close], TITLES, KINDS), "90th") == {"not contradicted"}


@pytest.mark.parametrize(
    ("lengths", "verdict", "interval"),
    [
        (np.linspace(1, 60, 30), "not contradicted", "from 45.8 s"),
        (np.linspace(61, 90, 30), "contradicted", "from 83.0 s"),
        (np.linspace(1, 30, 30), "not contradicted", "from 23.0 s"),
    ],
)
def test_few_tracks_leave_the_percentile_s_interval_open(lengths, verdict, interval):
    """Of under 36 tracks the longest may lie below the 90th percentile, so no upper end is known."""
    table = claims.test_claims([evidence(lengths=lengths)], TITLES, KINDS)
    row = table[table["our test"].str.startswith("90th")].iloc[0]
    assert (row["verdict"], row["95 % CI"]) == (verdict, interval)


def test_a_test_between_methods_has_one_corrected_p_everywhere():
    """That of the table of t-tests, from whichever side the claim looks."""
    errors = {**evidence().errors, "lstm": errors_of([0.95, 1.95, 9, 18], ("single",), seed=4)}
    one = evidence(errors=errors)
    table = claims.test_claims([one], TITLES, KINDS)
    for text, method, against, side in (
        ("ADE TC-CLiFF < CLiFF, 60 s", "tc_cliff", "cliff", "p_holm"),
        ("ADE LSTM < TC-CLiFF, 10 s", "tc_cliff", "lstm", "p_greater_holm"),
    ):
        for protocol in ("paper", "complete"):
            row = table[(table["our test"] == text) & (table["protocol"] == protocol)].iloc[0]
            wanted = {"protocol": protocol, "metric": "ade", "method": method, "against": against}
            found = one.tests[(one.tests[list(wanted)] == list(wanted.values())).all(axis=1)]
            found = found[found["horizon_s"] == float(text.split()[-2])].iloc[0]
            assert row["p Holm"] == found[side]
            assert abs(row["mean difference"]) == abs(found["mean_difference_m"])


def test_other_tests_are_corrected_over_those_of_a_dataset_and_protocol():
    study = {value: errors_of([1, 2, 4, base], seed=int(10 * value)) for value, base in ((0.1, 20), (1, 8), (10, 9))}
    table = claims.test_claims([evidence(studies={"beta": study})], TITLES, KINDS)
    own = table[table["our test"].str.contains("β|ranked|gain") & table["p"].notna()]
    for _, family in own.groupby("protocol"):
        p = family["p"].to_numpy(float)
        assert family["p Holm"].min() == pytest.approx(min(p.min() * len(p), 1))


def test_both_verdicts_need_a_corrected_p():
    """A difference whose interval just leaves 0 is no contradiction, as it would be no support."""
    rng = np.random.default_rng(3)
    shift = rng.normal(0, 1, 200)
    worse = errors_of([1, 2, 4, 8])
    for key, one in worse.items():
        noise = (shift - shift.mean()) / shift.std(ddof=1) + 2.1 / np.sqrt(200)  # t = 2.1
        worse[key] = one._replace(ade=one.ade + noise[None, :, None])
    errors = {**evidence().errors, "tc_cliff": worse, "cliff": errors_of([1, 2, 4, 8])}
    table = claims.test_claims([evidence(errors=errors)], TITLES, KINDS)
    row = table[table["our test"] == "ADE TC-CLiFF < CLiFF, 60 s"].iloc[0]
    assert float(row["95 % CI"].split()[0]) > 0
    assert (row["verdict"], row["p Holm, opposite"] > 0.05) == ("not shown", True)


def test_a_verdict_that_rests_on_tracks_without_a_forecast_says_so():
    """CLiFF is held at t0 on 40 of 200 tracks, which are all that TC-CLiFF is better on."""
    held = np.arange(200) < 40
    same = errors_of([1, 2, 4, 8])
    noise = np.random.default_rng(9).normal(0, 0.01, (1, 200, 1))
    worse = {
        key: one._replace(ade=one.ade + noise + 3.0 * held[None, :, None], unknown=held) for key, one in same.items()
    }
    table = claims.test_claims([evidence(errors={"tc_cliff": same, "cliff": worse})], TITLES, KINDS)
    row = table[table["our test"] == "ADE TC-CLiFF < CLiFF, 60 s"].iloc[0]
    assert row["p Holm"] < 0.001
    assert row["verdict"] == "supported only by tracks that one side could not forecast"
    assert row["not forecast"] == 40


def test_tests_of_the_claims_own_count_who_could_not_be_forecast():
    """Each rests on 40 of 200 tracks that one side could not forecast, or is the same without them."""
    held = np.arange(200) < 40

    def unforeseen(errors, by, what="ade"):
        noise = np.random.default_rng(9).normal(0, 0.01, (1, 200, 1))
        shift = np.where(held[None, :, None], by, noise)
        return {key: one._replace(**{what: getattr(one, what) + shift}, unknown=held) for key, one in errors.items()}

    same = errors_of([1, 2, 4, 8])
    lstm = unforeseen(errors_of([1, 2, 4, 8], ("single",)), -3.0, "fde")
    errors = {**evidence().errors, "tc_cliff": same, "lstm": lstm}
    radius = {1: same, 0.5: unforeseen(same, 3.0), 3: unforeseen(errors_of([1, 2, 4, 9]), 1.0)}
    known = {
        "errors": errors,
        "studies": {"sampling_radius_m": radius},
        "dataset": dataclasses.replace(HALL, label="x"),
    }
    table = claims.test_claims([evidence(**known, idle=frozenset(same["mean", "paper"].keys[:60]))], TITLES, KINDS)
    assert verdicts(table, "r_s = 1 < r_s = 0.5") == {"supported only by tracks that one side could not forecast"}
    assert verdicts(table, "r_s = 1 < r_s = 3") == {"supported"}
    assert verdicts(table, "those who idle") == {"supported only by tracks that one side could not forecast"}
    for text in ("r_s = 1 <", "those who idle", "0.5 × LSTM"):
        assert set(table[table["our test"].str.contains(text, regex=False)]["not forecast"]) == {40}


def test_what_is_known_needs_the_same_corrected_p():
    """A p of 0.04 without the tracks that one side could not forecast is none among many tests."""
    one = evidence()
    one = one._replace(tests=one.tests.assign(n_unknown=3, p_known=0.04, p_known_holm=0.5))
    assert verdicts(claims.test_claims([one], TITLES, KINDS), "ADE TC-CLiFF < CLiFF, 60 s") == {
        "supported only by tracks that one side could not forecast"
    }


@pytest.mark.parametrize(
    ("apart", "persons", "said"),
    [
        (1.0, 200, "the difference does not vary: not tested"),
        (0.0, 200, "no difference"),
        (1e-9, 200, "no difference"),
        (1.0, 1, "too few tracks"),
        (0.0, 1, "too few tracks"),
    ],
)
def test_without_a_p_the_verdict_says_why(apart, persons, said):
    """Both in the table of t-tests and where the claims test themselves: a share of 0 against one of 1."""
    person = np.array([f"day/{n % persons}" for n in range(200)])
    ours, theirs = (
        {
            (output, protocol): one._replace(
                ade=np.ones_like(one.ade) + more, infeasible=np.zeros_like(one.ade) + more, person=person
            )
            for (output, protocol), one in errors_of([1, 1, 1, 1], ("single",)).items()
        }
        for more in (0.0, apart)
    )
    study = {1: ours, 3: theirs}
    hall = dataclasses.replace(HALL, floor_plan=("a", "b"))
    known = evidence(dataset=hall, errors={"tc_cliff": ours, "lstm": theirs}, studies={"sampling_radius_m": study})
    table = claims.test_claims([known], TITLES, KINDS)
    if apart != 1e-9:  # of shares of 0 and 1e-9 the one is not the other's rounding
        assert verdicts(table, "share into walls TC-CLiFF < LSTM") == {said}
    for text in ("ADE TC-CLiFF < LSTM, 60 s", "r_s = 1 < r_s = 3"):
        assert verdicts(table, text) == {said}


def test_a_pair_is_tested_once():
    """0.5 is both the lowest β and one below 1."""
    study = {value: errors_of([1, 2, 4, 8], seed=int(10 * value)) for value in (0.5, 1)}
    table = claims.test_claims([evidence(studies={"beta": study})], TITLES, KINDS)
    assert table["our test"].str.contains("β = 0.5 < β = 1,").sum() == 2  # protocols


@pytest.mark.parametrize("own", [True, False])
def test_ranking_is_tc_cliff_s_whatever_stands_before_it(own):
    """A variant without a ranking is named first; without TC-CLiFF's own ranking nothing is tested."""
    middle = errors_of([1, 2, 4, 8], ("median", "mean"))
    errors = {"tc_middle": middle, "tc_cliff": errors_of([1, 2, 4, 8]) if own else middle}
    titles, kinds = {**TITLES, "tc_middle": "Median"}, {**KINDS, "tc_middle": "tc_cliff"}
    table = claims.test_claims([evidence(errors=errors)], titles, kinds)
    assert table["our test"].str.contains("ADE ranked < mean").sum() == 2 * own
    assert (verdicts(table, "needs TC-CLiFF with ranked") == {"not tested"}) != own


def test_the_paper_s_p_belongs_to_equal_or_higher():
    """The factor of two is a claim of its own, without that p."""
    errors = {**evidence().errors, "lstm": errors_of([1, 1.8, 9, 14], ("single",), seed=4)}
    table = claims.test_claims([evidence(errors=errors)], TITLES, KINDS)
    plain, half = (table[table["our test"] == f"ADE TC-CLiFF < {x}LSTM, 60 s"] for x in ("", "0.5 × "))
    assert set(plain["the paper's p"]) == {"< 0.001"} and set(plain["verdict"]) == {"supported"}
    assert set(half["the paper's p"]) == {"–"} and set(half["verdict"]) == {"contradicted"}


def test_claims_are_about_the_paper_s_methods_and_no_variants():
    """A network whose scenes are not turned is not the paper's; that maps keep out of walls is said beside networks."""
    kinds = {**KINDS, "lstm_axes": "lstm", "tc_clean": "tc_cliff", "line": "cvm"}
    titles = {**TITLES, "lstm_axes": "LSTM, not turned", "tc_clean": "TC-CLiFF, positions", "line": "CVM, positions"}
    assert not [pair for pair in claims.claimed_pairs(kinds) if {"lstm_axes", "tc_clean"} & set(pair)]
    errors = {**evidence().errors, "lstm": errors_of([1, 2, 9, 18], ("single",), seed=4)}
    errors |= {"lstm_axes": errors["lstm"], "tc_clean": errors["tc_cliff"], "line": errors["cvm"]}
    errors = {
        name: {key: one._replace(infeasible=one.ade) for key, one in outputs.items()}
        for name, outputs in errors.items()
    }
    places = HALL, dataclasses.replace(HALL, label="edin"), dataclasses.replace(HALL, floor_plan=("plan",))
    table = pd.concat(claims.test_claims([evidence(errors=errors, dataset=one)], titles, kinds) for one in places)
    assert table["our test"].str.contains("LSTM").any()
    walls = table["our test"].str.contains("walls")
    assert walls.sum() == 6 and table["our test"][walls].str.contains("< LSTM").all()  # three maps, two protocols
    assert not table["our test"].str.contains("not turned|positions").any()


def test_claims_about_the_hour_need_a_clock():
    forum = dataclasses.replace(HALL, label="edin", clock="estimated")
    table = claims.test_claims([evidence(dataset=forum)], TITLES, KINDS)
    about = table[table["claim"] == claims.CLAIMS["tc_cliff"].text]
    assert set(about["verdict"]) == {"not tested"}
    assert about["our test"].str.contains("clock").all()


def test_claims_about_edinburgh():
    """That TC-CLiFF has the lowest error, and that maps overtake networks."""
    errors = {**evidence().errors, "lstm": errors_of([0.5, 1.8, 9, 14], ("single",), seed=4)}
    table = claims.test_claims(
        [evidence(errors=errors, dataset=dataclasses.replace(HALL, label="edin"))], TITLES, KINDS
    )
    best = table[table["claim"] == claims.CLAIMS["best"].text].set_index("our test")["verdict"]
    assert set(best["ADE TC-CLiFF < STeF, 60 s"]) == {"contradicted"}
    assert set(best["ADE TC-CLiFF < CVM, 60 s"]) == {"supported"}
    overtaking = table[table["claim"] == claims.CLAIMS["overtaking"].text]
    assert set(overtaking["verdict"]) == {"supported"}


def test_an_unknown_dataset_is_asked_every_claim(tmp_path):
    """And the table is written in all forms, labelled as demo."""
    table = claims.test_claims([evidence(dataset=dataclasses.replace(HALL, label="own"))], TITLES, KINDS)
    assert set(table["claim"]) == {claim.text for claim in claims.CLAIMS.values()}
    write_claims(table, True, str(tmp_path / "claims"))
    assert "Demo data" in (tmp_path / "claims.md").read_text()
    assert len(pd.read_csv(tmp_path / "claims.csv")) == len(table)
    assert (tmp_path / "claims.html").read_text().count("<tr>") == len(table) + 1
