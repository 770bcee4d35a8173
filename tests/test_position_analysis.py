"""The position analysis: numbers of samples, inputs, and analyses without a motion."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.plugin.motion import PositionAnalysis


@pytest.mark.parametrize(
    ("mechanism", "samples"), [("four_bar", (5,)), ("bevel_differential", (3, 2))]
)
def test_an_array_of_sample_numbers_is_a_sequence(mechanism, samples):
    """`samples` may be an array of NumPy: the result is that of the tuple."""
    array = np.array(samples)
    traced = sk.trace(mechanism, samples=array)
    np.testing.assert_array_equal(
        traced.values, sk.trace(mechanism, samples=samples).values
    )
    assert len(sk.run(mechanism, samples=array).frame("motion")) == len(traced)
    study = sk.Study("study", sk.load(mechanism), samples=array)
    assert study == sk.Study("study", sk.load(mechanism), samples=samples)
    assert study.shape == samples


def test_a_coupling_table_accepts_an_array_of_node_numbers():
    """Node numbers in an array of NumPy give the table of the tuple."""
    nodes = (9,)
    options = {"tolerance": 0.1}
    table = sk.coupling_table("four_bar", samples=np.array(nodes), **options)
    assert table.count == sk.coupling_table("four_bar", samples=nodes, **options).count


def test_one_sample_number_of_numpy_is_a_number_of_times():
    """With a duration, an integer of NumPy is one number, not a grid."""
    laws = {"21": sk.ConstantSpeed(0.0, 1.0)}
    run_result = sk.run("four_bar", samples=np.int64(5), duration=1.0, laws=laws)
    assert len(run_result.frame("motion")) == 2 * 5  # two assembly modes


def test_a_study_does_not_change_with_the_list_it_was_made_from():
    """The study keeps its own copy of the numbers of samples."""
    samples = [3, 2]
    study = sk.Study("study", sk.load("two_dof_spm"), samples=samples)
    samples[0] = 9
    assert study.shape == (3, 2)


def test_an_analysis_without_motion_has_its_attributes():
    """With `follow=False` nothing was searched, and the attributes say so."""
    analysis = PositionAnalysis(sk.load("four_bar"), follow=False)
    assert analysis.probe_count == 0
    assert analysis.methods == [None]
    assert str(analysis.claim) == "sampled: no motion was traced"
    with pytest.raises(sk.SpherekitError, match="modes found are none"):
        analysis.find_mode_index(0)


@pytest.mark.parametrize("q", ["abc", [0.1, "x"], [1.0 + 2.0j]])
def test_inputs_that_are_no_real_numbers_are_refused(q):
    """The error is one of spherekit, and names the argument."""
    analysis = PositionAnalysis(sk.load("four_bar"), samples=2)
    with pytest.raises(sk.SpherekitError, match="at: q is"):
        analysis.at(q)
