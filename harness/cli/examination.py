"""What `bench doctor` prints."""

from __future__ import annotations

from shading_atlas_bench.harness.console import make_console, make_table


def show_examination() -> bool:
    """Print what the doctor found; False if something needed is missing or wrong."""
    from shading_atlas_bench.harness.doctor.examine import examine

    marks = {True: "[green]ok[/]", False: "[red]no[/]", None: "[yellow]--[/]"}
    table = make_table("bench doctor", "", "what", "found")
    findings = examine()
    for finding in findings:
        table.add_row(marks[finding.ok], finding.name, finding.detail.replace("[", "\\["))
    make_console().print(table)
    return all(finding.ok is not False for finding in findings)
