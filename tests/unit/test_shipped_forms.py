"""The dataset files that are shipped for public recordings read files of those forms, here made-up ones."""

import json

import numpy as np
import pytest
from test_other_readers import magni

from modlhmp.cleaning import clean_recording
from modlhmp.ids import id_of

PEOPLE, ROWS = 40, 30
STEP_M = 0.48  # in 0.4 s: 1.2 m/s


def walks(step_frames):
    """(frame, person from 1, x, y) of people who come one after the other and walk across a hall, in time."""
    rows = [
        (step_frames * (5 * person + k), person + 1, STEP_M * k, float(person % 7))
        for person in range(PEOPLE)
        for k in range(ROWS)
    ]
    return sorted(rows)


def plain(step_frames, form, head=""):
    return head + "".join(form.format(f=f, p=p, x=x, y=y) + "\n" for f, p, x, y in walks(step_frames))


def ndjson():
    scenes = [{"scene": {"id": 0, "p": 1, "s": 0, "e": 200, "fps": 2.5, "tag": 0}}]
    tracks = [{"track": {"f": f, "p": p, "x": round(x, 2), "y": y}} for f, p, x, y in walks(10)]
    return "".join(json.dumps(one) + "\n" for one in scenes + tracks)


OBSMAT = "  {f:.7e}  {p:.7e}  {x:.7e}  0.0000000e+00  {y:.7e}  1.2000000e+00  0.0000000e+00  0.0000000e+00\r"
FORMS = {
    "hotel": plain(10, "{f}\t{p}.0\t{x:.2f}\t{y:.2f}"),
    "eth": plain(6, "{f}\t{p}.0\t{x:.2f}\t{y:.2f}"),
    "eth_obsmat": plain(10, OBSMAT),
    "trajnetpp": ndjson(),
    "juelich": plain(10, "{p} {f} {x:.4f} {y:.4f} 1.76", "# framerate: 25 fps\n# id frame x/m y/m z/m\n"),
    "magni": magni(rows=1500),
    "thor1": "".join(
        f"{f / 25 + 0.02:.2f},{12000 + p},{x:.3f},{y:.3f},1.2,0.0\n" for f, p, x, y in walks(10)
    ),
    "magni_a": "Time,ag_id,x,y,speed,x_speed,y_speed,theta_delta,data_label\n" + "".join(
        f"{f / 25:.2f},Helmet_{p},{x:.6f},{y:.6f},1.2,1.2,0,0,Visitors-Alone\n" for f, p, x, y in walks(10)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_file_of_the_form_is_read_as_it_is_meant(load_shipped, tmp_path, name):
    path = tmp_path / load_shipped(name, tmp_path).recordings[0].file
    path.parent.mkdir(parents=True)
    path.write_text(FORMS[name], newline="")
    dataset = load_shipped(name, tmp_path)
    tracks, account = clean_recording(path, dataset, dataset.recordings[0])
    assert len(tracks.bounds()) - 1 >= 2
    np.testing.assert_allclose(tracks.speed[np.isfinite(tracks.speed)], 1.2, rtol=0.03)
    kept = account["rows"]["kept"] + account["rows"]["dropped"].get("other_split", 0)
    assert set(account["rows"]["dropped"]) <= {"other_split", "comment_line"}
    assert kept + account["rows"]["dropped"].get("comment_line", 0) == account["rows"]["read"]
    if name == "magni":
        assert set(tracks.track_id.tolist()) == {id_of("Helmet_1"), id_of("Helmet_2")}


def test_the_literature_s_eth_is_the_same_people_faster(load_shipped, tmp_path):
    """15 frames a second read as 25."""
    path = tmp_path / "eth_ucy/biwi_eth.txt"
    path.parent.mkdir()
    path.write_text(FORMS["eth"], newline="")
    fast = load_shipped("eth_fast", tmp_path)
    tracks, _ = clean_recording(path, fast, fast.recordings[0])
    np.testing.assert_allclose(np.nanmedian(tracks.speed), 1.2 * 25 / 15, rtol=0.01)
