defmodule BB.Bus.Sim.GPIO.Agenda do
  @moduledoc """
  What is to happen to simulated lines, and when. Pure.

  Each entry belongs to somebody, who may take all of theirs back. Entries of the same time come in the order in which they were put.

      iex> alias BB.Bus.Sim.GPIO.Agenda
      iex> agenda = Agenda.new() |> Agenda.put(20, :b, :second) |> Agenda.put(10, :a, :first)
      iex> Agenda.next_ns(agenda)
      10
      iex> {10, :a, :first, agenda} = Agenda.take(agenda, 15)
      iex> Agenda.take(agenda, 15)
      :none
      iex> agenda |> Agenda.drop(:b) |> Agenda.next_ns()
      nil
  """

  defstruct entries: :gb_sets.empty(), count: 0

  @opaque t :: %__MODULE__{}

  @doc "Nothing."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "Puts an entry of `owner`'s for a time."
  @spec put(t(), integer(), term(), term()) :: t()
  def put(%__MODULE__{entries: entries, count: count}, time_ns, owner, what) do
    entry = {time_ns, count, owner, what}
    %__MODULE__{entries: :gb_sets.add_element(entry, entries), count: count + 1}
  end

  @doc "The time of the first entry; `nil` when there is none."
  @spec next_ns(t()) :: integer() | nil
  def next_ns(%__MODULE__{entries: entries}) do
    unless :gb_sets.is_empty(entries), do: entries |> :gb_sets.smallest() |> elem(0)
  end

  @doc "Takes the first entry if its time is not after `now_ns`: `{time_ns, owner, what, agenda}` or `:none`."
  @spec take(t(), integer()) :: {integer(), term(), term(), t()} | :none
  def take(%__MODULE__{entries: entries} = agenda, now_ns) do
    with false <- :gb_sets.is_empty(entries),
         {{time_ns, _, owner, what}, rest} when time_ns <= now_ns <-
           :gb_sets.take_smallest(entries) do
      {time_ns, owner, what, %{agenda | entries: rest}}
    else
      _none_or_later -> :none
    end
  end

  @doc "Takes back all entries of `owner`'s."
  @spec drop(t(), term()) :: t()
  def drop(%__MODULE__{entries: entries} = agenda, owner),
    do: %{agenda | entries: :gb_sets.filter(&(elem(&1, 2) != owner), entries)}
end
