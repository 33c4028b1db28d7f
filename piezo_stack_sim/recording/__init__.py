# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings: rosbag2 and CSV in, CSV and rosbag2 out, checked and mended by preflight.

SI units everywhere; no ROS is needed. `read_set` reads, `preflight` checks, the writers write.
"""

from piezo_stack_sim.recording.bag import read_bag
from piezo_stack_sim.recording.bag_writer import write_bag
from piezo_stack_sim.recording.csv_file import read_csv
from piezo_stack_sim.recording.finding import Finding
from piezo_stack_sim.recording.mapping import parse_mapping, parse_units
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.read import read_set
from piezo_stack_sim.recording.recording import Recording, RecordingSet
from piezo_stack_sim.recording.write import CsvWriter, write_csv, write_csv_set

__all__ = [
    'CsvWriter',
    'Finding',
    'parse_mapping',
    'parse_units',
    'preflight',
    'read_bag',
    'read_csv',
    'read_set',
    'Recording',
    'RecordingSet',
    'write_bag',
    'write_csv',
    'write_csv_set',
]
