"""How recordings are opened, followed and split."""

SENSORS = ("single_chip", "cascade")  # radars of ColoRadar's rig
IQ_ORDERS = ("IIQQ", "QQII", "IQIQ", "QIQI", "I4Q4", "Q4I4", "I")  # in adc_data.bin
ROTATIONS = ("imu", "poses", "lidar", "none")  # sources of a rig's rotation
SPLITS = ("train", "validation", "test")
