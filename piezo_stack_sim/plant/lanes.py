# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Eight weighted sums at a time: the product of a small matrix with a vector.

The compiler finds no use for the lanes of the processor in products as small as those of a
sub-step, which are most of its work: here they are asked for.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8  # what is a column of weights, and what is set, is filled up to a multiple of it


def padded(size: int) -> int:
    """Return how many entries hold ``size`` of them in whole lanes."""
    return -(-size // LANES) * LANES


@intrinsic
def sums(typingctx, weights, start, stride, z, used, out, first):
    """
    Set out[first + i] to the sum over c of weights[start + c stride + i] z[c], i < LANES.

    ``weights`` is walked as it lies in memory, whatever its shape; c runs below ``used``.
    Nothing is checked: both it and ``out`` must reach that far (:func:`padded`).
    """
    signature = types.void(weights, types.int64, types.int64, z, types.int64, out, types.int64)
    lanes = ir.VectorType(ir.DoubleType(), LANES)
    same = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    zero = ir.Constant(ir.IntType(32), 0)
    empty = ir.Constant(lanes, ir.Undefined)

    def generate(context, builder, signature, values):
        weights, z, out = (context.make_array(signature.args[i])(context, builder, values[i]).data
                           for i in (0, 3, 5))
        start, stride, used, first = (values[i] for i in (1, 2, 4, 6))
        total = cgutils.alloca_once_value(builder, ir.Constant(lanes, None))
        with cgutils.for_range(builder, used) as column:
            at = builder.add(start, builder.mul(column.index, stride))
            weight = builder.load(
                builder.bitcast(builder.gep(weights, [at]), lanes.as_pointer()), align=8)
            value = builder.load(builder.gep(z, [column.index]))
            value = builder.shuffle_vector(
                builder.insert_element(empty, value, zero), empty, same)
            product = builder.fmul(weight, value, flags=('contract',))
            builder.store(builder.fadd(builder.load(total), product, flags=('contract',)), total)
        target = builder.bitcast(builder.gep(out, [first]), lanes.as_pointer())
        builder.store(builder.load(total), target, align=8)
        return context.get_dummy_value()

    return signature, generate
