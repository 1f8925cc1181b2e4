<<<<<<< HEAD
"""Tests of the room `lidar`."""
=======
"""Tests of the LiDAR's preparation."""
>>>>>>> lidar
