// The constants of both kernels of crowds.

// Instances of an item.
layout(constant_id = 2) const uint INSTANCES = 1;
// 1: all instances of all items start from the base pose, which is loaded once.
// Plus 2: sums are rounded to the pose's unit, and not each product (ROUNDED_PRODUCTS).
layout(constant_id = 3) const uint REBUILT_ITEMS = 0;
const bool ALL_REBUILT = (REBUILT_ITEMS & 1u) != 0u;
const bool LOADS_POSES = (REBUILT_ITEMS & 1u) == 0u;
const bool ROUNDED_SUMS = (REBUILT_ITEMS & 2u) != 0u;
// Bits that rounding drops of each product: 16; none where sums are rounded. Constants instead of branches:
// SwiftShader's compiler removes no branch, and its time grows faster than their number.
const uint PRODUCT_BITS = 16u - 8u * (REBUILT_ITEMS & 2u);
const int PRODUCT_HALF = int((1u << PRODUCT_BITS) >> 1);
