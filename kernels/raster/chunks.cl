// Chunks: runs of nearly equal length that one work-item each takes on.
#include "common/wide.cl"

// Where a chunk of `count` things begins.
INLINE int chunk_start(const int count, const int chunk, const int chunks)
{
    return (long)count * chunk / chunks;
}
