"""Neural fields keep the laws of closest points."""

from cpmkit_neural.plugin import cpmkit_conformance_cases

from cpmkit.plugin import parametrize_with_laws


@parametrize_with_laws(cpmkit_conformance_cases())
def test_neural_fields_keep_the_laws(case, law):
    law(case)
