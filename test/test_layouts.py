# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the layouts for PlotJuggler and Foxglove: they show what the node really sends."""

import json
import re
from xml.etree import ElementTree

from piezo_stack_sim.resources import config_file
import pytest

WANTED = {f'/piezo_stack_node/{name}' for name in (
    'voltage_command', 'displacement', 'charge', 'force', 'voltage')} | {'/diagnostics'}


@pytest.fixture(scope='module')
def graph():
    """Topics of a node with its default name: type by topic, and its diagnostics' series."""
    rclpy = pytest.importorskip('rclpy')
    from piezo_stack_sim.node.actuator_node import ActuatorNode
    from piezo_stack_sim.node.simulation_clock import SimulationClock
    from ros_process import DOMAIN, NOMINAL
    rclpy.init(args=[], domain_id=DOMAIN)
    sent = []
    try:
        node = ActuatorNode(SimulationClock(), files=[NOMINAL],
                            cli_args=['--ros-args', '--params-file', NOMINAL])
        node._diagnostics.publish = sent.append
        node.keep_house()
        me = node.get_name(), node.get_namespace()
        topics = dict(node.get_publisher_names_and_types_by_node(*me)
                      + node.get_subscriber_names_and_types_by_node(*me))
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    status = sent[0].status[0]
    # As PlotJuggler names the numbers in diagnostics.
    series = {f'/diagnostics/{status.hardware_id}/{status.name}/{v.key}' for v in status.values}
    return {name: kinds[0] for name, kinds in topics.items()}, series


def is_number_of(topics, topic, field):
    kind = topics.get(topic)
    if kind == 'std_msgs/msg/Float64':
        return field == 'data'
    return kind == 'sensor_msgs/msg/JointState' and re.fullmatch(
        r'(position|velocity|effort)\[0\]', field)


def test_foxglove_shows_only_what_the_node_sends(graph):
    topics, _ = graph
    layout = json.loads(config_file('foxglove.json').read_text(encoding='utf-8'))
    panels = layout['configById']
    shown = set()
    for panel in panels.values():
        paths = [*panel.get('paths', []), *filter(None, [panel.get('xAxisPath')])]
        for path in paths:
            topic, _, field = path['value'].partition('.')
            assert is_number_of(topics, topic, field), path['value']
            shown.add(topic)
        if 'topicToRender' in panel:
            assert topics[panel['topicToRender']] == 'diagnostic_msgs/msg/DiagnosticArray'
            shown.add(panel['topicToRender'])
    assert WANTED <= shown

    def placed(node):
        return {node} if isinstance(node, str) else placed(node['first']) | placed(node['second'])

    assert placed(layout['layout']) == set(panels)


def test_foxglove_draws_both_loops_over_voltage():
    panels = json.loads(config_file('foxglove.json').read_text(encoding='utf-8'))['configById']
    loops = {panel['paths'][0]['value'] for panel in panels.values()
             if panel.get('xAxisPath', {}).get('value') == '/piezo_stack_node/voltage.data'}
    assert loops == {'/piezo_stack_node/displacement.data', '/piezo_stack_node/charge.data'}


def test_plotjuggler_shows_only_what_the_node_sends(graph):
    topics, series = graph
    layout = ElementTree.parse(config_file('plotjuggler.xml')).getroot()
    selected = {topic.get('name') for topic in layout.iter('topic')}
    assert selected <= set(topics) and WANTED <= selected
    loops = set()
    for plot in layout.iter('plot'):
        for curve in plot.iter('curve'):
            names = [curve.get('name')]
            if plot.get('mode') == 'XYPlot':
                names = [curve.get('curve_x'), curve.get('curve_y')]
                loops.add(tuple(names))
            for name in names:
                if name.startswith('/diagnostics/'):
                    assert name in series
                    continue
                topic, _, field = name.rpartition('/')
                assert topic in selected and is_number_of(topics, topic, field), name
    voltage = '/piezo_stack_node/voltage/data'
    assert loops == {(voltage, '/piezo_stack_node/displacement/data'),
                     (voltage, '/piezo_stack_node/charge/data')}
