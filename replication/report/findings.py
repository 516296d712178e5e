"""The findings: sentences whose numbers come from the results, each with links to its proof."""

from dataclasses import dataclass

from replication import published


@dataclass(frozen=True)
class Finding:
    """A sentence, and the label and address of each proof; `kind` is "finding" or "open"."""

    kind: str
    text: str
    proofs: tuple[tuple[str, str], ...]


def findings(facts: dict[str, str]) -> list[Finding]:
    """Fill in the findings' numbers."""
    found = []
    for row in published.findings().to_dict("records"):
        try:
            text = row["text"].format_map(facts)
        except KeyError:
            continue
        proofs = tuple(tuple(proof.strip().split("|")) for proof in row["proof"].split(";"))
        found.append(Finding(row["kind"], text, proofs))
    return found
