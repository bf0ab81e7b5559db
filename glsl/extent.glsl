// The component-wise minimum and maximum of the values of a workgroup's lanes: exact in any order.

shared vec3 shared_low[WORKGROUP], shared_high[WORKGROUP];

// Lane 0 has the result.
void reduce(inout vec3 low, inout vec3 high) {
    uint lane = gl_LocalInvocationID.x;
    shared_low[lane] = low;
    shared_high[lane] = high;
    for (uint half_of = WORKGROUP / 2u; half_of > 0u; half_of /= 2u) {
        memoryBarrierShared();
        barrier();
        if (lane < half_of) {
            low = min(low, shared_low[lane + half_of]);
            high = max(high, shared_high[lane + half_of]);
            shared_low[lane] = low;
            shared_high[lane] = high;
        }
    }
}
