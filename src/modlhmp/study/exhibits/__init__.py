"""The paper's tables and figures, and those beyond it: one module and one record (`record.Exhibit`) each."""

from modlhmp.study.exhibits import of_ladder, of_places, of_results, of_truth
from modlhmp.study.exhibits.record import Exhibit

EXHIBITS: tuple[Exhibit, ...] = (*of_results.EXHIBITS, *of_ladder.EXHIBITS, *of_places.EXHIBITS, *of_truth.EXHIBITS)
