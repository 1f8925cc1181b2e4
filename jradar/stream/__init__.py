"""A radar on the cable: packets to frames to clouds, for files, robots and a browser.

DCA1000 ---UDP--> Receiver -> Assembler -> newest Frame -> Processor -> writers
Emulator --^

"""
