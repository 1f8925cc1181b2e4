"""Scripts of mmWave Studio in the form of public courses, for tests."""

TWO_LANES, FOUR_LANES = "0, 1, 1, 0, 0, 1, 0, 0", "0, 1, 1, 1, 1, 1, 0, 0"
SCRIPT = """\
-- Chirp
START_FREQ = 77 -- GHz
local SLOPE = {slope};
NUM_SAMPLES = {samples}
--[==[ an older one: ]]
ar1.ProfileConfig(0, 60, 7, 5, 57, 0, 0, 0, 0, 0, 0, 1, 0, 64, 1e4, 0, 0, 30) ]==]
ar1.SelectChipVersion("AR1243")
ar1.SelectChipVersion("{chip}")
if (ar1.ChanNAdcConfig(1, 1, 1, 1, 1, 1, 1, 2, 1, 0) == 0) then
    WriteToLog("ar1.ProfileConfig(1) -- Success\\n", "green")
end
ar1.DataPathConfig(513, 1216644097, 0)
ar1.LvdsClkConfig(1, 1)
ar1.LVDSLaneConfig({lanes})
if (ar1.ProfileConfig(0, START_FREQ, 7, {adc_start}, {ramp_end}, 0, 0, 0, 0, 0, 0,
                      SLOPE, 0, NUM_SAMPLES, {rate}, 0, 0, 30) == 0) then
    WriteToLog('Success', "green")
end
ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, 0, 1, 0)
ar1.ChirpConfig(1, 1, 0, 0, 0, 0, 0, 1, 0, 0)
ar1.ChirpConfig(2, 2, 0, 0, 0, 0, 0, 0, 0, 1)
ar1.FrameConfig(0, 2, {frames}, 1, 20, 0, 0, 1)
"""
COM304 = {
    **{"slope": 70.15, "samples": 512, "chip": "XWR1843", "lanes": TWO_LANES},
    **{"adc_start": 5.28, "ramp_end": 57, "rate": 10000, "frames": 20},
}
COM405 = COM304 | {
    **{"slope": 64.598, "samples": 128, "lanes": FOUR_LANES},
    **{"adc_start": 8.66, "ramp_end": 61.89, "rate": 2500, "frames": 1000},
}


def script(values=COM304, **changes):
    """Return a script with these values."""
    return SCRIPT.format(**values | changes)
