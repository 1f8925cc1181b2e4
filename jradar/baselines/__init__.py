"""Learned methods that the diffusion model is compared with.

RPDNet        a network in the place of a CFAR detector
map_values    its input: a map of power, scaled to 0 .. 1
"""

from jradar.baselines.rpdnet import RPDNet as RPDNet, map_values as map_values
