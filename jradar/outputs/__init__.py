"""Everything that jradar writes for other programs; it replaces only what it wrote.

    guard           GuardedFolder, check_replaceable: what a command may replace
    clouds          write_ply, write_pcd, write_csv, write_npz: one cloud, one file
    frame_folder    FrameFolder: clouds, arrays and a picture of each frame
    page            write_page: one HTML file with clouds that can be rotated

    published       Published: one frame as writers of many frames take it
    writers         open_writer: a writer of many frames, by the output's name
    messages        MessageWriter: one file of messages, which is whole once a second
    foxglove, ros2  an MCAP file with Foxglove's messages, and a ROS 2 bag
    video           MP4 and GIF

Names are imported from these modules: `guard` loads no JAX, and only `video`, `page`
and pictures load matplotlib.
"""
