# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The package as pip and colcon install it."""

from pathlib import Path
import re
import subprocess
import sys
import tarfile
from xml.etree import ElementTree
import zipfile

import pytest

ROOT = Path(__file__).resolve().parent.parent

pytestmark = pytest.mark.skipif(
    not (ROOT / 'setup.py').is_file(), reason='the tests run outside a checkout')


@pytest.fixture(scope='module')
def setup_arguments():
    """Return what setup.py passes to setuptools."""
    from unittest import mock
    with mock.patch('setuptools.setup') as setup:
        code = compile((ROOT / 'setup.py').read_text(encoding='utf-8'), 'setup.py', 'exec')
        exec(code, {'__file__': str(ROOT / 'setup.py'), '__name__': 'setup'})
    return setup.call_args.kwargs


@pytest.fixture(scope='module')
def archives(tmp_path_factory):
    """Build sdist and wheel of the tracked files; return both paths."""
    pytest.importorskip('setuptools', minversion='70.1')  # builds wheels alone
    folder = tmp_path_factory.mktemp('build')
    source = folder / 'source'
    source.mkdir()
    for name in tracked():
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((ROOT / name).read_bytes())
    code = ('import sys; from setuptools import build_meta; folder = sys.argv[1]; '
            'build_meta.build_sdist(folder); build_meta.build_wheel(folder)')
    done = subprocess.run([sys.executable, '-c', code, str(folder)], cwd=source,
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return next(folder.glob('*.tar.gz')), next(folder.glob('*.whl'))


def tracked():
    """Return the files of the checkout that git tracks and that exist."""
    done = subprocess.run(['git', 'ls-files'], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        pytest.skip('not a git checkout')
    return [name for name in done.stdout.splitlines() if (ROOT / name).is_file()]


def test_nothing_is_tracked_outside_the_known_folders():
    # What a scratch script left in the checkout goes along with everything that is added.
    folders = {name.partition('/')[0] for name in tracked() if '/' in name}
    assert folders <= {'.ci', 'config', 'doc', 'piezo_stack_sim', 'resource', 'test', 'tools'}


def test_wheel_and_sdist_hold_what_the_package_reads(archives):
    sdist, wheel = archives
    with zipfile.ZipFile(wheel) as archive:
        packed = [re.sub(r'^[^/]+\.data/data/share/[^/]+/', '', n) for n in archive.namelist()]
    with tarfile.open(sdist) as archive:
        packed_source = [name.partition('/')[2] for name in archive.getnames()]
    used = [name for name in tracked()
            if name.startswith(('config/', 'piezo_stack_sim/')) or name == 'package.xml']
    assert set(used) <= set(packed)
    assert set(used) <= set(packed_source)
    assert not [name for name in packed if name.startswith('test')]


def test_every_console_script_points_to_a_module_of_the_package(setup_arguments):
    for script in setup_arguments['entry_points']['console_scripts']:
        name, module = re.match(r'(\S+) = ([\w.]+):main$', script).groups()
        path = ROOT / (module.replace('.', '/') + '.py')
        assert path.is_file(), name
        assert re.search(r'^def main\(', path.read_text(encoding='utf-8'), re.MULTILINE)


def test_package_xml_setup_py_and_changelog_agree(setup_arguments):
    xml = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert xml.findtext('name') == setup_arguments['name']
    assert xml.findtext('version') == setup_arguments['version']
    assert xml.findtext('license') == setup_arguments['license']
    changelog = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    assert re.search(r'^(\d+\.\d+\.\d+)', changelog, re.MULTILINE).group(1) \
        == setup_arguments['version']


def test_every_module_says_whose_it_is_and_under_which_licence():
    for folder in ('piezo_stack_sim', 'test', 'tools'):
        for path in (ROOT / folder).rglob('*.py'):
            head = path.read_text(encoding='utf-8').splitlines()[:3]
            if head:
                assert any(line.startswith('# Copyright ') for line in head), path
                assert '# SPDX-License-Identifier: Apache-2.0' in head, path


def test_every_python_requirement_has_its_rosdep_key(setup_arguments):
    xml = ElementTree.parse(ROOT / 'package.xml').getroot()
    keys = {element.text for element in xml if element.tag.endswith('depend')}
    for requirement in setup_arguments['install_requires']:
        name = re.match(r'\w+', requirement).group().replace('pyyaml', 'yaml')
        if name != 'rosbags':  # pip only, see package.xml
            assert f'python3-{name}' in keys


def test_only_the_node_and_the_examples_import_ros():
    ros = re.compile(r'^\s*(import|from) (rclpy|\w+_msgs|rcl_interfaces|std_srvs)\b', re.MULTILINE)
    for path in (ROOT / 'piezo_stack_sim').rglob('*.py'):
        folder = path.relative_to(ROOT / 'piezo_stack_sim').parts[0]
        if folder not in ('node', 'examples'):
            assert not ros.search(path.read_text(encoding='utf-8')), path
