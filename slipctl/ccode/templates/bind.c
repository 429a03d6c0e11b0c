#include "@n@.h"
#include <time.h>

int bind_sizes(int which);
int bind_replay(int ticks, const @n@_in *in, const @n@_param *param, @n@_state *state, @n@_out *out,
                @real@ *states, int *status, const @n@_in *beside, @n@_state *other);
void bind_numbers(const @n@_state *state, @real@ *states);
void bind_take(const @real@ *states, @n@_state *state);

//@ if n_state
@access@

//@ end
int bind_sizes(int which)
{
    const size_t sizes[4] = {
        sizeof(@n@_in), sizeof(@n@_param), sizeof(@n@_state), sizeof(@n@_out)
    };
    return (int)sizes[which];
}

int bind_replay(int ticks, const @n@_in *in, const @n@_param *param, @n@_state *state, @n@_out *out,
                @real@ *states, int *status, const @n@_in *beside, @n@_state *other)
{
    @n@_out unseen;
    int k;
    int bad = 0;
    for (k = 0; k < ticks; ++k) {
        if (beside != 0) {
            (void)@n@_step(&beside[k], param, other, &unseen);
        }
        status[k] = @n@_step(&in[k], param, state, &out[k]);
        bad += (status[k] != 0);
//@ if n_state
        numbers_of(&state->kept, states + k * @n_state@);
//@ else
        (void)states;
//@ end
    }
    return bad;
}

void bind_numbers(const @n@_state *state, @real@ *states)
{
//@ if n_state
    numbers_of(&state->kept, states);
//@ else
    (void)state, (void)states;
//@ end
}

void bind_take(const @real@ *states, @n@_state *state)
{
//@ if n_state
    take_numbers(states, &state->kept);
//@ else
    (void)state, (void)states;
//@ end
}
