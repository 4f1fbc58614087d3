defmodule BB.Bus.Sim.GPIO.Agenda do
  @moduledoc """
  The events of a simulated chip of lines that are still to come, ordered by their times.

  `BB.Bus.Sim.GPIO.Chip` has one. An entry has an owner, whose entries can all be dropped. Entries
  of the same time come in the order in which they were put. The module is pure.

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

  @typedoc "An agenda."
  @opaque t :: %__MODULE__{}

  @doc "Returns an empty agenda."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "Adds an event of `owner` at a time."
  @spec put(t(), integer(), term(), term()) :: t()
  def put(%__MODULE__{entries: entries, count: count}, time_ns, owner, event) do
    entry = {time_ns, count, owner, event}
    %__MODULE__{entries: :gb_sets.add_element(entry, entries), count: count + 1}
  end

  @doc "Returns the time of the first entry, or `nil`."
  @spec next_ns(t()) :: integer() | nil
  def next_ns(%__MODULE__{entries: entries}) do
    unless :gb_sets.is_empty(entries), do: entries |> :gb_sets.smallest() |> elem(0)
  end

  @doc """
  Takes the first entry, if its time is not after `now_ns`.

  Returns `{time_ns, owner, event, agenda}` or `:none`.
  """
  @spec take(t(), integer()) :: {integer(), term(), term(), t()} | :none
  def take(%__MODULE__{entries: entries} = agenda, now_ns) do
    with false <- :gb_sets.is_empty(entries),
         {{time_ns, _, owner, event}, rest} when time_ns <= now_ns <-
           :gb_sets.take_smallest(entries) do
      {time_ns, owner, event, %{agenda | entries: rest}}
    else
      _none_or_later -> :none
    end
  end

  @doc "Removes all entries of `owner`."
  @spec drop(t(), term()) :: t()
  def drop(%__MODULE__{entries: entries} = agenda, owner),
    do: %{agenda | entries: :gb_sets.filter(&(elem(&1, 2) != owner), entries)}
end
