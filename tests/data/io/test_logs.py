"""`read_ulog` and `read_mdf`: signals with clocks of their own, and the refusals."""

import gc
import struct
import sys

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data import read_mdf, read_ulog, resample

pytest.importorskip("pyulog")
asammdf = pytest.importorskip("asammdf")

START = 5_000_000  # start of the log [us]
GYRO = 20_000 * np.arange(200) + START + 1_000  # times of the gyro [us]
RATE = np.sin(2e-6 * GYRO)
MOTOR = 50_000 * np.arange(80) + START  # times of the motor command [us]


def _message(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), kind[0]) + body


def ulog_bytes() -> bytes:
    """A log after PX4's description of the file format: two gyros and a motor."""
    file = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", START)
    file += _message(b"F", b"gyro:uint64_t timestamp;float[3] xyz;")
    file += _message(b"F", b"motor:uint64_t timestamp;float control;")
    for number, (instance, topic) in enumerate([(0, b"gyro"), (1, b"gyro"), (0, b"motor")]):
        file += _message(b"A", struct.pack("<BH", instance, number) + topic)
    for t, p in zip(GYRO, RATE, strict=True):
        file += _message(b"D", struct.pack("<HQfff", 0, t, p, 0.0, 2.0))
        file += _message(b"D", struct.pack("<HQfff", 1, t, -p, 0.0, 0.0))
    for number, t in enumerate(MOTOR):
        file += _message(b"D", struct.pack("<HQf", 2, t, number % 2))
    return file


@pytest.fixture(scope="module")
def ulog(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.ulg"
    path.write_bytes(ulog_bytes())
    return path


@pytest.fixture(scope="module")
def mdf(tmp_path_factory):
    """A measurement with two groups, each with a channel `current`."""
    path = tmp_path_factory.mktemp("log") / "drive.mf4"
    with asammdf.MDF() as file:
        for k, (step, unit) in enumerate([(0.01, "A"), (0.05, "mA")]):
            t = step * np.arange(100)
            signals = [asammdf.Signal(np.cos(t), t, unit=unit, name="current")]
            if k == 0:
                conversion = {"a": 0.5, "b": 1.0}  # value = 0.5 raw + 1
                raw = np.arange(100, dtype=np.int16)
                signals.append(
                    asammdf.Signal(raw, t, unit="rad/s", name="speed", conversion=conversion)
                )
            file.append(signals)
        file.save(path)
    return path


def test_ulog_signals_have_one_clock(ulog):
    places = {"p": "gyro.xyz[0]", "second": "gyro[1].xyz[0]", "u": "motor.control"}
    log = read_ulog(ulog, places)
    t, p = log.signals["p"]
    np.testing.assert_allclose(t, 1e-6 * (GYRO - START), rtol=1e-12)
    np.testing.assert_array_equal(p, RATE.astype(np.float32))
    np.testing.assert_array_equal(log.signals["second"][1], -RATE.astype(np.float32))
    np.testing.assert_allclose(log.signals["u"][0], 1e-6 * (MOTOR - START), rtol=1e-12)
    assert "200 samples" in str(log)


def test_ulog_becomes_a_record_by_resample(ulog):
    log = read_ulog(ulog, {"p": "gyro.xyz[0]", "u": "motor.control"})
    made = resample(
        log.signals,
        step=0.02,
        inputs=("u",),
        outputs=("p",),
        held=("u",),
        units={"p": "rad/s"},
    ).record
    inside = np.interp(np.asarray(made.t), 1e-6 * (GYRO - START), RATE)
    known = np.asarray(made.mask)[:, 0]
    assert np.sum(~known) <= 2  # the gyro begins after the motor
    np.testing.assert_allclose(np.asarray(made.z)[known, 0], inside[known], atol=0.02)


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ({"p": "gyro"}, "is not a topic and a field"),
        ({"p": "magnetometer.x"}, "gyro"),
        ({"u": "motor.control", "p": "magnetometer.x"}, "gyro"),
        ({"p": "gyro[2].xyz[0]"}, r"gyro\[1\]"),
        ({"p": "gyro.xyz[3]"}, r"xyz\[2\]"),
    ],
)
def test_place_that_a_ulog_lacks_is_refused(ulog, places, words):
    with pytest.raises(InputError, match=words):
        read_ulog(ulog, places)


def test_damaged_ulog_is_refused_unless_accepted(tmp_path):
    whole = ulog_bytes()
    cut = tmp_path / "cut.ulg"
    middle = len(whole) // 2
    cut.write_bytes(whole[:middle] + bytes(60) + whole[middle:])
    with pytest.raises(InputError, match="accept_damage"):
        read_ulog(cut, {"p": "gyro.xyz[0]"})
    rest = read_ulog(cut, {"p": "gyro.xyz[0]"}, accept_damage=True)
    assert 0 < rest.signals["p"][0].size < GYRO.size


def test_mdf_signals_are_converted_and_have_units(mdf):
    log = read_mdf(mdf, {"i": ("current", 1), "w": "speed"})
    assert log.units == {"i": "mA", "w": "rad/s"}
    t, i = log.signals["i"]
    np.testing.assert_allclose(t, 0.05 * np.arange(100))
    np.testing.assert_allclose(i, np.cos(t))
    np.testing.assert_allclose(log.signals["w"][1], 0.5 * np.arange(100) + 1.0)
    made = resample(log.signals, step=0.05, inputs=("i",), outputs=("w",), units=log.units)
    assert float(np.max(np.abs(made.record.u))) <= 1e-3  # mA in SI


@pytest.mark.parametrize(
    ("places", "words"),
    [
        ({"i": "current"}, r"groups 0, 1. Name one, as \('current', 0\)"),
        ({"i": ("current", 7)}, "group with the channel 'current'"),
        ({"i": "torque"}, "speed"),
    ],
)
def test_channel_that_an_mdf_lacks_is_refused(mdf, places, words):
    with pytest.raises(InputError, match=words):
        read_mdf(mdf, places)


def _refusal(read, path) -> str | None:
    """Return the message of a refusal; None if the file was read."""
    try:
        read(path)
    except InputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("kind", ["ULog", "MDF"])
def test_damaged_file_is_read_or_refused_by_name(tmp_path, mdf, kind, monkeypatch):
    # The destructor of asammdf fails for a file that it could not open.
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)

    def read(path):
        if kind == "MDF":
            return read_mdf(path, {"w": "speed"})
        return read_ulog(path, {"p": "gyro.xyz[0]"}, accept_damage=True)

    path, rng = tmp_path / "damaged.log", np.random.default_rng(0)
    path.write_bytes(b"time,p\n0,1\n")
    assert f"cannot be read as {kind}" in str(_refusal(read, path))
    whole, messages = mdf.read_bytes() if kind == "MDF" else ulog_bytes(), []
    for _ in range(40):
        damaged = bytearray(whole)
        for at in rng.integers(0, len(damaged), 20):
            damaged[at] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(1, len(damaged))])
        messages.append(_refusal(read, path))
    gc.collect()
    refused = [message for message in messages if message is not None]
    assert refused
    assert all("damaged.log" in message for message in refused)
