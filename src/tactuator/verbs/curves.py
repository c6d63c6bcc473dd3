"""The verb `curves`: the threshold curves that there are, and where each was felt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tactuator.table import Chart, ChartLine, ResultTable
from tactuator.verbs.parameters import Argument, Figures, Place
from tactuator.verbs.result import Result

if TYPE_CHECKING:
    from tactuator.perception.curve import ThresholdCurve


@dataclass(frozen=True, eq=False, repr=False)
class CurvesResult(Result):
    """Threshold curves with where they were felt. It draws them beside each other.

    figures: their folder, where asked for.
    """

    curves: "tuple[ThresholdCurve, ...]"
    figures: Path | None = None

    def headline(self) -> Mapping[str, str]:
        return {curve.name: curve.contact.said.get("site", "nobody said where") for curve in self.curves}

    def to_dict(self) -> dict[str, Any]:
        from tactuator.parameters import plain

        return {"curves": [plain(curve) for curve in self.curves]}

    def tables(self) -> Sequence[ResultTable | str]:
        from tactuator.parameters import parameters
        from tactuator.perception.curve import Contact

        keys = tuple(parameters(Contact))
        columns = ("curve", "provenance", "band", *(key.rsplit("_", 1)[0] if "_" in key else key for key in keys))
        rows = tuple(
            (
                curve.name,
                curve.provenance,
                f"{curve.frequency_hz[0]:g} to {curve.frequency_hz[-1]:g} Hz",
                *(curve.contact.said.get(key, "not stated") for key in keys),
            )
            for curve in self.curves
        )
        table = ResultTable("", columns, rows, tuple(f"{curve.name}: {curve.source}" for curve in self.curves))
        at_finger = any("finger" in curve.contact.site for curve in self.curves)
        return [table, *([] if at_finger else ["none of these was felt at a fingertip: measure your own"])]

    def chart(self) -> Chart:
        lines = [
            ChartLine(
                f"{curve.name} ({curve.contact.said.get('site', 'site not stated')}, {curve.provenance})",
                curve.frequency_hz,
                curve.level_db_re_1um,
                "o-",
                None if curve.standard_error_db is None else 1.959964 * curve.standard_error_db,
                colour=number,
            )
            for number, curve in enumerate(self.curves)
        ]
        return Chart("frequency (Hz)", "threshold (dB re 1 µm, peak)", lines, log_x=True)


def curves(
    files: Annotated[
        "Sequence[Place]", Argument("Curves of your own beside the library's (CSV).", file=True, type=list[Path] | None)
    ] = (),
    figures: Figures = None,
) -> CurvesResult:
    """List the threshold curves of the library, and your own. Each with where it was felt, and how the numbers came.

    A curve holds for the contact that it was measured at.
    """
    from tactuator.io.csv_tables import read_curve
    from tactuator.perception.curve import curve, curve_names

    read = [read_curve(Path(file)) for file in files or ()]
    result = CurvesResult((*map(curve, curve_names()), *read), None if figures is None else Path(figures))
    if figures is not None:
        from tactuator.report.chart import chart_plate
        from tactuator.report.plate import save_plates

        save_plates([chart_plate(result.chart(), "curves", "Detection thresholds.")], Path(figures))
    return result
