/* All the arithmetic for one kind of processor. */
#include "lanes_body.h"

#include "scalar_body.h"

#include "switching_body.h"

#include "backward_body.h"

#include "hmm_body.h"

#include "lanes_end.h"
