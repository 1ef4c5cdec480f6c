"""Write messages into a bag until killed."""

import sys
import time
from itertools import count

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter

writer = BagWriter(sys.argv[1], [RecordedTopic('/text', 'std_msgs/msg/String')])
for number in count(1):
    now = time.time_ns()
    writer.write(RecordedMessage(0, number.to_bytes(8, 'little') * 20, now, now, number))
    time.sleep(1e-3)
