"""Words of a command line become Hydra's overrides: paths, options, quoting, and unknown names refused."""

from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from hand_recon.command_line.configuration_files import CONF, booleans, groups, known_names
from hand_recon.command_line.resolvers import register_resolvers
from hand_recon.command_line.verbs import VERBS
from hand_recon.command_line.words import UsageError, to_overrides

NAMES = [
    "$HOME.json", "50%.json", "[v2].json", "a#b.json", "a&b.json", "a,b.json", "a:b.json", "hands (1).json",
    "hands~.json", "it's.json", "josé.json", "my hands.json", "x=1.json", "{a}.json", "手.json", "~.json",
    "set a\\0.json", "back\\'slash.json", "${a}.json", "'quoted'.json", 'dou"ble.json', " blank .json",
]  # fmt: skip
"""File names that have broken some command line."""


def overrides(verb: str, *words: str) -> list[str]:
    """The words after a verb, translated with its own configuration file."""
    return to_overrides(
        words, VERBS[verb], known_names(verb), booleans=booleans(verb), groups=groups(verb)
    )


def landmarks(*words: str) -> str | None:
    """The path that `fit` receives."""
    register_resolvers()
    with initialize_config_dir(CONF, version_base="1.3"):
        path: str | None = compose("fit", overrides("fit", *words)).landmarks
    return path


@pytest.mark.parametrize("name", NAMES)
def test_every_file_name_is_read_as_it_was_typed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("[]")
    assert landmarks(name) == name
    assert landmarks(f"landmarks={name}") == name
    assert landmarks("--landmarks", name) == name
    assert landmarks(f"--landmarks={name}") == name


@given(st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), min_size=1))
@settings(suppress_health_check=[HealthCheck.too_slow])
@example("\\")
@example("a\\'")
@example("${x}\\")
def test_any_text_survives_quoting(text: str) -> None:
    # Interpolations stay Hydra's, and below a folder no text is a list or a quote in its grammar.
    assert landmarks(f"--landmarks=/d/{text}".replace("${", "$ {")) == f"/d/{text}".replace(
        "${", "$ {"
    )


def test_a_tilde_is_the_home_folder_however_it_is_spelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/ann")
    for words in (["~/h.json"], ["landmarks=~/h.json"], ["--landmarks", "~/h.json"]):
        assert landmarks(*words) == "/home/ann/h.json"
    assert overrides("train", "data=freihand", "data.root=~/F") == [
        "data=freihand", "data.root='/home/ann/F'",
    ]  # fmt: skip


def test_hydras_own_quotes_lists_and_interpolations_stay_hydras() -> None:
    assert overrides("fit", "landmarks='a b.json'") == ["landmarks='a b.json'"]
    assert overrides("report", "runs=[outputs/a,outputs/b]") == ["runs=[outputs/a,outputs/b]"]
    assert overrides("fit", "output=${paths.output}/x") == ["output=${paths.output}/x"]
    assert overrides("fit", "landmarks=null") == ["landmarks=null"]


def test_options_and_assignments_mean_the_same() -> None:
    assert overrides("fit", "h.json", "--prior", "none", "--descent.steps=5") == [
        "landmarks='h.json'", "prior=none", "descent.steps=5",
    ]  # fmt: skip
    assert overrides("fit", "--landmark-set", "mano") == ["landmark_set=mano"]
    assert overrides("doctor", "--json") == ["json=true"]
    assert overrides("doctor", "--json", "false") == ["json=false"]
    assert overrides("doctor", "/d", "--json") == ["folder='/d'", "json=true"]


def test_words_without_a_key_fill_the_verbs_keys_in_order() -> None:
    assert overrides("score", "pred.json", "gt", "protocol=freihand") == [
        "predictions='pred.json'", "ground_truth='gt'", "protocol=freihand",
    ]  # fmt: skip
    # A key that is given by name is not filled by position.
    assert overrides("score", "gt", "predictions=p.json")[0] == "ground_truth='gt'"
    assert overrides("prepare", "check", "data=views")[0] == "task='check'"
    assert overrides("fit", "--", "-odd.json") == ["landmarks='-odd.json'"]


def test_hydras_flags_pass() -> None:
    words = [
        "-m",
        "seed=0,1",
        "--cfg",
        "job",
        "-c=job",
        "--resolve",
        "~logger",
        "+trainer.fast_dev_run=true",
    ]
    # Flags come first: Hydra reads no override after a flag that follows another override.
    flags = ["-m", "--cfg", "job", "-c=job", "--resolve"]
    assert overrides("train", *words) == [*flags, *(word for word in words if word not in flags)]
    assert overrides("train", "--info", "seed=1") == ["--info", "seed=1"]
    assert overrides("train", "seed=1", "-sc", "install=bash") == ["seed=1", "-sc", "install=bash"]


def test_a_path_by_position_or_option_is_never_hydras_grammar() -> None:
    for name in ("[v2]", "'w'", "null"):
        assert landmarks(name) == landmarks("--landmarks", name) == name
    assert overrides("report", "[a,b]") == ["runs=[a,b]"]


def test_a_group_of_the_defaults_list_may_be_given_with_or_without_a_plus() -> None:
    row = ["experiment=ablation_row3"]
    assert overrides("train", "+experiment=ablation_row3") == overrides("train", *row) == row


def test_keys_that_a_recipe_adds_are_known() -> None:
    """`crop_size` is in conf/recipe, not in conf/train.yaml."""
    assert overrides("train", "crop_size=48") == ["crop_size=48"]


def test_a_sweep_over_files_names_each_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("b 1.json", "a.json"):
        Path(name).write_text("[]")
    expected = ["-m", "landmarks='a.json','b 1.json'"]
    assert overrides("fit", "-m", "landmarks=glob(*.json)") == expected
    assert overrides("fit", "-m", "landmarks=a.json,b 1.json") == expected
    with pytest.raises(UsageError, match=r"glob\(\*\.csv\) matches no file"):
        overrides("fit", "-m", "landmarks=glob(*.csv)")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["+output_dir=out"], "Unknown option 'output_dir' of `fit`; did you mean output?"),
        (["--outptu", "out"], "Unknown option '--outptu' of `fit`; did you mean output?"),
        (["priors=none"], "Unknown option 'priors' of `fit`; did you mean prior?"),
        (["-o", "out"], "Unknown option '-o'"),
        (["--output"], "Option --output lacks its value"),
        (["--output", "--intrinsics", "K.json"], "lacks its value; --intrinsics is an option"),
        (["a.json", "b.json"], "Unexpected word 'b.json': `fit` takes landmarks by position"),
    ],
)
def test_what_is_not_known_is_refused_with_the_nearest_name(words: list[str], message: str) -> None:
    with pytest.raises(UsageError) as refused:
        overrides("fit", *words)
    assert message in str(refused.value)


def test_a_verb_without_files_refuses_a_word() -> None:
    with pytest.raises(UsageError, match=r"`train` takes options as name=value"):
        overrides("train", "datta")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["a.jpg"], ["input=['a.jpg']"]),
        (["a.jpg", "output=out", "it's [b], c.jpg"], ["output='out'", r"input=['a.jpg','it\'s [b], c.jpg']"]),
        (
            ["--output", "o", "--strict", "x.jpg", "--json", "-"],
            ["output='o'", "strict=true", "json=-", "input=['x.jpg']"],
        ),
        (["--", "-x.jpg", "--strict"], ["input=['-x.jpg','--strict']"]),
        (["input=[a.jpg,b]"], ["input=[a.jpg,b]"]),
        (["input=a b.jpg"], ["input='a b.jpg'"]),
        (["camera=fov=60", "a"], ["camera='fov=60'", "input=['a']"]),
    ],
)  # fmt: skip
def test_a_verb_may_take_any_number_of_files(words: list[str], expected: list[str]) -> None:
    assert overrides("predict", *words) == expected


def test_names_of_a_list_are_written_with_commas_alone() -> None:
    expected = ["source='a.json'", "format=[glb,bvh]"]
    assert overrides("export", "a.json", "format=glb,bvh") == expected
    assert overrides("export", "a.json", "--format", "glb,bvh") == expected
    assert overrides("export", "a.json", "format=glb, bvh")[1] == "format=[glb, bvh]"
    assert overrides("export", "a.json", "format=[glb,bvh]") == expected
    # In a sweep, commas are Hydra's.
    assert "format=glb,bvh" in overrides("export", "-m", "a.json", "format=glb,bvh")
