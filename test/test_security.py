# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the DDS security files: who may command; nothing of the node is forgotten."""

from fnmatch import fnmatchcase
import os
import subprocess
import sys
from xml.etree import ElementTree

from piezo_stack_sim.resources import config_folder
import pytest

FOLDER = config_folder() / 'security'
DEVICE, CONTROLLER, OBSERVER = ('/piezo_stack/device', '/piezo_stack/controller',
                                '/piezo_stack/observer')
COMMANDS = {f'rt/piezo_stack_node/{name}'
            for name in ('voltage_command', 'charge_command', 'external_force')}
# Children in the order that the schemas of DDS Security 1.1 want; * may come several times.
SCHEMA = {
    'dds': ('permissions|domain_access_rules',), 'permissions': ('grant*',),
    'grant': ('subject_name', 'validity', 'allow_rule*', 'default'),
    'validity': ('not_before', 'not_after'), 'allow_rule': ('domains', 'publish*', 'subscribe*'),
    'publish': ('topics',), 'subscribe': ('topics',), 'topics': ('topic*',),
    'domains': ('id_range*',), 'id_range': ('min', 'max'),
    'domain_access_rules': ('domain_rule*',),
    'domain_rule': ('domains', 'allow_unauthenticated_participants', 'enable_join_access_control',
                    'discovery_protection_kind', 'liveliness_protection_kind',
                    'rtps_protection_kind', 'topic_access_rules'),
    'topic_access_rules': ('topic_rule*',),
    'topic_rule': ('topic_expression', 'enable_discovery_protection',
                   'enable_liveliness_protection', 'enable_read_access_control',
                   'enable_write_access_control', 'metadata_protection_kind',
                   'data_protection_kind')}


def root(name):
    return ElementTree.parse(FOLDER / name).getroot()


def grants():
    """Return what each enclave may publish and subscribe to, in names of DDS."""
    return {grant.get('name'): {
        kind: {topic.text for topic in grant.findall(f'allow_rule/{kind}/topics/topic')}
        for kind in ('publish', 'subscribe')} for grant in root('permissions.xml').iter('grant')}


def allowed(enclave, kind, name):
    return any(fnmatchcase(name, pattern) for pattern in grants()[enclave][kind])


@pytest.mark.parametrize('name', ['governance.xml', 'permissions.xml'])
def test_every_element_stands_where_the_schema_wants_it(name):
    for element in root(name).iter():
        children = [child.tag for child in element]
        wanted = list(SCHEMA.get(element.tag, ()))
        for tag in children:
            while wanted and tag not in wanted[0].rstrip('*').split('|'):
                assert wanted.pop(0).endswith('*'), (element.tag, tag)
            assert wanted, f'{element.tag} has no {tag} there'
            if not wanted[0].endswith('*'):
                wanted.pop(0)
        assert all(rest.endswith('*') for rest in wanted), (element.tag, wanted)


def test_nobody_without_a_certificate_takes_part_and_all_is_encrypted():
    rules = {element.tag: element.text for element in root('governance.xml').iter()}
    assert rules.pop('allow_unauthenticated_participants') == 'false'
    for tag, text in rules.items():
        if tag.startswith('enable_'):
            assert text == 'true', tag
        if tag.endswith('_kind'):
            assert text == 'ENCRYPT', tag
    assert rules['topic_expression'] == '*'


def test_what_is_not_granted_is_denied():
    for grant in root('permissions.xml').iter('grant'):
        assert grant.findtext('default') == 'DENY'
        assert grant.findtext('subject_name') == f'CN={grant.get("name")}'
    assert set(grants()) == {DEVICE, CONTROLLER, OBSERVER}


def test_only_the_controller_commands_and_only_the_device_answers():
    for name in COMMANDS:
        assert [e for e in grants() if allowed(e, 'publish', name)] == [CONTROLLER]
    for name in ('reset', 'step', 'pause', 'set_parameters', 'set_parameters_atomically'):
        request = f'rq/piezo_stack_node/{name}Request'
        assert [e for e in grants() if allowed(e, 'publish', request)] == [CONTROLLER]
        reply = f'rr/piezo_stack_node/{name}Reply'
        assert [e for e in grants() if allowed(e, 'publish', reply)] == [DEVICE]
    for name in ('displacement', 'charge', 'force', 'voltage', 'state'):
        topic = f'rt/piezo_stack_node/{name}'
        assert [e for e in grants() if allowed(e, 'publish', topic)] == [DEVICE]


def test_the_policy_of_sros_says_the_same_as_the_permissions():
    policy = root('policy.xml')
    said = {}
    for enclave in policy.iter('enclave'):
        rights = said[enclave.get('path')] = {'publish': {'ros_discovery_info'},
                                              'subscribe': {'ros_discovery_info'}}
        for topics in enclave.iter('topics'):
            for kind in ('publish', 'subscribe'):
                if topics.get(kind) == 'ALLOW':
                    rights[kind] |= {f'rt{topic.text}' for topic in topics}
        for services in enclave.iter('services'):
            requests = {f'rq{service.text}Request' for service in services}
            replies = {f'rr{service.text}Reply' for service in services}
            serves = services.get('reply') == 'ALLOW'
            rights['publish'] |= replies if serves else requests
            rights['subscribe'] |= requests if serves else replies
    assert said == grants()


def test_nothing_of_the_running_node_is_forgotten():
    rclpy = pytest.importorskip('rclpy')
    from piezo_stack_sim.node.actuator_node import ActuatorNode
    from piezo_stack_sim.node.simulation_clock import SimulationClock
    from ros_process import DOMAIN
    rclpy.init(args=[], domain_id=DOMAIN)
    try:
        node = ActuatorNode(SimulationClock(), cli_args=['--ros-args', '-p', 'stepping:=lockstep'])
        me = node.get_name(), node.get_namespace()
        publishes = {f'rt{n}' for n, _ in node.get_publisher_names_and_types_by_node(*me)}
        listens = {f'rt{n}' for n, _ in node.get_subscriber_names_and_types_by_node(*me)}
        serves = [n for n, _ in node.get_service_names_and_types_by_node(*me)]
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    assert COMMANDS <= listens and len(publishes) >= 8 and len(serves) >= 9
    publishes |= {f'rr{name}Reply' for name in serves}
    listens |= {f'rq{name}Request' for name in serves} | {'rt/clock'}  # with use_sim_time
    assert [name for name in publishes if not allowed(DEVICE, 'publish', name)] == []
    assert [name for name in listens if not allowed(DEVICE, 'subscribe', name)] == []


def test_where_security_is_demanded_and_not_to_be_had_the_node_does_not_start(tmp_path):
    pytest.importorskip('rclpy')
    from ros_process import ENVIRONMENT, PATIENCE
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_stack_sim.node.main', '--ros-args', '--enclave', DEVICE],
        env={**ENVIRONMENT, 'ROS_SECURITY_KEYSTORE': os.fspath(tmp_path),
             'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'},
        capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 2
    assert 'SECURITY ERROR' in done.stderr and 'Traceback' not in done.stderr
