"""The takes that the lifter is tuned and calibrated on, and never trained on."""

HELD_OUT = (
    "01_14 02_06 05_09 06_08 07_08 08_05 09_05 135_martial_04 60_salsa_10 60_salsa_25 "
    "94_indian_14 walking_extra_walking_50 directing_traffic_directing_traffic_4"
)
