@head@

#include "Rte_@swc@.h"

#include "@n@.h"

//@ if arrays
#include <string.h>

//@ end
static @n@_param param;
static @n@_state state;

void @swc@_init(void);
void @swc@_step(void);

void @swc@_init(void)
{
    @n@_default(&param);
    (void)@n@_init(&param, &state);
}

void @swc@_step(void)
{
@body@
}
