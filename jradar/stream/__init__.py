"""A radar on the cable: packets to frames, frames to clouds, clouds to files and robots.

DCA1000 --UDP--> Receiver -> Assembler -> newest Frame -> Processor -> writers
emulator -^                                                  MCAP, ROS 2, Foxglove

"""
